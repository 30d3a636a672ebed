"""What was estimated is told in a sentence each while that is little, and in one line and a table where it is much."""

from teamslam.results.estimated import FEW, estimated_lines, estimated_table, many


def report(cameras: int, times: int = 2, told: bool = True) -> dict:
    """A report with so many numbers of places, each a little farther off, and of times."""
    names = ["latency"] * times + ["x"] * cameras
    unknowns = [
        {"of": f"tag {n}", "name": name, "unit": "m", "value": 1e-3 * n, "sigma": 1e-3, "told": told, "stated": 0.0,
         "prior": 5e-3}
        for n, name in enumerate(names)
    ]  # fmt: skip
    sentences = [f"sentence {n}." for n in range(len(names))]
    return {"estimated": {"sentences": [*sentences, "They still moved."], "unknowns": unknowns, "why": None}}


def test_a_few_numbers_have_a_sentence_each():
    few = report(FEW)
    assert not many(few) and estimated_lines(few) == few["estimated"]["sentences"]
    assert estimated_lines({"estimated": None}) == [] and not many({"estimated": None})


def test_of_many_one_line_tells_the_farthest_and_the_table_has_them_all():
    found = report(40)
    times, summary, last = estimated_lines(found)[:2], estimated_lines(found)[2], estimated_lines(found)[-1]
    assert many(found) and len(estimated_lines(found)) == 4
    assert times == ["sentence 0.", "sentence 1."] and last == "They still moved."
    assert summary.startswith("40 numbers") and "all of them" in summary and summary.endswith("sentence 41.")
    assert len(estimated_table(found).rows) == 42


def test_what_was_not_told_is_not_said_to_be_better_known():
    assert "0 of them" in estimated_lines(report(40, told=False))[2]


def test_where_nothing_was_estimated_the_reason_stands_alone():
    found = report(40)
    found["estimated"] |= {"why": "the log was changed", "sentences": ["Nothing was estimated."]}
    assert not many(found) and estimated_lines(found) == ["Nothing was estimated."]
