"""The summary of several bodies names each of them, and says of each pair what it transmits."""

import re

import numpy as np
import pytest
from pressed_pairs import pair, stack


def lines(result):
    """Names and values of the summary."""
    return dict(
        re.split(r"  +", line.strip(), maxsplit=1) for line in result.summary().split("\n")[1:]
    )


def test_pairs_of_a_stack():
    result = stack().solve()
    said = lines(result)
    assert [name for name in said if "block" in name or "body" in name] == [
        *("top block", "body 1", "low/block")
    ]
    for k, whose in enumerate(("'top block'", "body 1", "'low/block'")):
        line = said["tie 1" if k == 1 else f"contact {k}"]
        assert line.endswith(f"on {whose}")
        assert line.startswith(f"{np.sum(result.part == k)} points: ")
        force = [float(v) for v in re.search(r"; \((.*)\)", line)[1].split(", ")]
        # Six digits are printed.
        assert force == pytest.approx(
            (result.tie_resultants if k == 1 else result.resultants)[k], rel=1e-5, abs=1e-12
        )
    assert "15 bonded" in said["tie 1"]
    assert "bonded" not in said["contact 0"]


def test_certificate_is_the_worst_of_all_bodies():
    result = pair().solve()
    worst = max(result.kkt.values())
    assert lines(result)["certificate"].startswith(f"no residual above {worst:.1e}")


def test_table_has_the_same(make):
    result = pair().solve()
    for value in ("upper", "lower", "contact 0", "on &#x27;upper&#x27;"):
        assert value in result._repr_html_()
    _, alone = make.solved()
    assert list(lines(alone))[:1] == ["body"]
    assert "resultant" in lines(alone)
    assert "contact 0" not in lines(alone)
