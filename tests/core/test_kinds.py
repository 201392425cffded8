"""Kinds of special points by their words and by the codes that AUTO and MatCont use."""

import pytest

from hbnlp.core.kinds import End, FoldEvent, Kind


@pytest.mark.parametrize(
    ("word", "kind"),
    [
        ("LP", Kind.FOLD),
        ("bp", Kind.BRANCH_POINT),
        ("PD", Kind.PERIOD_DOUBLING),
        ("NS", Kind.NEIMARK_SACKER),
        ("TR", Kind.NEIMARK_SACKER),
        ("HB", Kind.HOPF),
        ("H", Kind.HOPF),
        ("fold", Kind.FOLD),
        ("neimark-sacker", Kind.NEIMARK_SACKER),
        ("UZ", Kind.EVENT),
        (Kind.PEAK, Kind.PEAK),
    ],
)
def test_a_kind_is_known_by_word_and_code(word, kind):
    assert Kind.of(word) is kind


@pytest.mark.parametrize("kind", list(Kind))
def test_every_kind_has_a_code_that_leads_back_to_it(kind):
    assert Kind.of(kind.code) is kind


@pytest.mark.parametrize("unknown", ["SN", "", 3, None])
def test_an_unknown_kind_is_refused_with_those_that_are_known(unknown):
    with pytest.raises(ValueError, match=r"kind is .*; give a Kind, or one of 'fold' \(LP\), .*\(NS or TR\)"):
        Kind.of(unknown)


def test_events_of_fold_curves_are_known_by_their_words():
    assert FoldEvent.of("isola birth") is FoldEvent.ISOLA_BIRTH
    with pytest.raises(ValueError, match="kind is 'birth'; give a FoldEvent, or one of 'cusp', 'isola birth'"):
        FoldEvent.of("birth")


def test_a_branch_is_complete_at_an_end_of_its_span_or_closed():
    assert {end for end in End if end.complete} == {End.SPAN_END, End.SPAN_START, End.CLOSED, End.MET}
