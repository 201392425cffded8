"""Every public callable is tried with wrong kinds: an error of the package's own, at once, that names the argument."""

import logging
import signal

import matplotlib.pyplot as plt
import pytest
import wrong_kinds

CALLABLES = wrong_kinds.callables()
SECONDS = 20
"""An error comes at once; a call that is right may take its time."""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Write what is saved into a folder of its own, draw nothing, and end what hangs."""
    monkeypatch.chdir(tmp_path)
    logging.disable(logging.CRITICAL)

    def hang(*_):
        raise wrong_kinds.Hang

    before = signal.signal(signal.SIGALRM, hang)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)
    logging.disable(logging.NOTSET)
    plt.close("all")


def test_every_public_callable_has_a_right_call_with_all_its_arguments():
    examples = wrong_kinds.examples()
    assert CALLABLES.keys() == examples.keys()
    for label, function in CALLABLES.items():
        assert wrong_kinds.parameters_of(function).keys() == examples[label].keys() - {"self"}, label


@pytest.mark.parametrize("label", CALLABLES)
def test_wrong_kinds_are_refused_by_name(label):
    function, arguments = CALLABLES[label], wrong_kinds.examples()[label]
    faults = []
    for name, annotation in wrong_kinds.parameters_of(function).items():
        if (label, name) in wrong_kinds.LEFT_OUT:
            continue
        for wrong, value in wrong_kinds.WRONG.items():
            signal.alarm(SECONDS)
            try:
                outcome = wrong_kinds.trial(function, arguments, name, value)
            except wrong_kinds.Hang:
                outcome = "hangs"
            signal.alarm(0)
            accepted = outcome == "accepted" and wrong_kinds.excused(annotation, wrong, name)
            if outcome != "refused" and not accepted:
                faults.append(f"{name} = {wrong}: {outcome}")
    assert not faults, "\n".join(faults)
