"""How large the model of a call is, unless the user says so."""

import pytest

from encoder.coding.model_packet import BUDGETS, budget_for


@pytest.mark.parametrize("profile", ["default", "live"])
def test_a_model_grows_with_the_rate_from_where_faces_hardly_gain_by_it(profile: str) -> None:
    assert budget_for(profile, None) == budget_for(profile, None, 1200) == BUDGETS[profile]
    sizes = [budget_for(profile, None, bps).appearance_bytes for bps in (1200, 2000, 5000, 20_000)]
    assert sizes == sorted(set(sizes))
    usual, grown = BUDGETS[profile], budget_for(profile, None, 1201)
    assert grown.appearance_bytes == pytest.approx(usual.appearance_bytes, rel=0.001)
    most = budget_for(profile, None, 1e6)
    assert most.background_bytes == 8 * usual.background_bytes
    assert most == budget_for(profile, None, 30_000)


def test_a_size_that_is_asked_for_holds_at_any_rate() -> None:
    assert budget_for("default", 20_000, 5000) == budget_for("default", 20_000)
    assert budget_for("thesis", None, 5000) == BUDGETS["thesis"]
