"""Ctrl-C through every long verb is raised, or the verb returns what there is: ``python tests/soak.py`` does more."""

import numpy as np
import pytest
from soak import GOOD, interrupter, soak
from soak_verbs import VERBS


@pytest.mark.parametrize("name", [name for name in VERBS if name != "campaign"])
def test_an_interrupt_is_neither_swallowed_nor_loses_anything(name):
    with interrupter() as sender:
        outcomes, _ = soak(VERBS[name](), 3, np.random.default_rng(1), sender)
    assert outcomes.keys() <= GOOD
    assert outcomes.total() == 3


def test_a_campaign_that_was_interrupted_goes_on():
    pytest.importorskip("ngsolve")
    with interrupter() as sender:
        outcomes, _ = soak(VERBS["campaign"](), 1, np.random.default_rng(1), sender)
    assert outcomes.keys() <= GOOD
