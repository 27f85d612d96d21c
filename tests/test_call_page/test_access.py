"""Who may see and steer a call: only programs of this host that know the secret address."""

import pytest

from risorius.page.access import Access, random_token

ACCESS = Access(8123, "secret")
OWN = "http://127.0.0.1:8123"


def headers(**changed: str) -> dict[str, str]:
    return {"Host": "127.0.0.1:8123", **{k.replace("_", "-"): v for k, v in changed.items()}}


@pytest.mark.parametrize("extra", [{}, {"Origin": OWN}, {"Sec_Fetch_Site": "same-origin"}])
def test_the_page_itself_is_let_in(extra: dict[str, str]) -> None:
    assert ACCESS.refusal(headers(**extra), "secret", is_websocket=False) is None


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost"])
def test_a_websocket_of_the_page_is_let_in(name: str) -> None:
    own = headers(Host=f"{name}:8123", Origin=f"http://{name}:8123")
    assert ACCESS.refusal(own, "secret", is_websocket=True) is None


@pytest.mark.parametrize(
    "foreign",
    [
        {"Host": "evil.example:8123"},
        {"Host": "127.0.0.1:80"},
        {"Origin": "http://evil.example"},
        {"Origin": "http://127.0.0.1:9999"},
        {"Origin": "null"},
        {"Origin": f"{OWN}.evil.example"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
    ],
)
@pytest.mark.parametrize("is_websocket", [False, True])
def test_who_knows_the_secret_but_comes_from_elsewhere_is_refused(
    foreign: dict[str, str], is_websocket: bool
) -> None:
    asked = headers(**{"Origin": OWN, **foreign})
    assert ACCESS.refusal(asked, "secret", is_websocket) is not None


@pytest.mark.parametrize("token", ["", "secre", "secrett", "Secret", "géheim"])
def test_who_does_not_know_the_secret_is_refused(token: str) -> None:
    assert ACCESS.refusal(headers(Origin=OWN), token, is_websocket=False) is not None


def test_a_websocket_without_an_origin_is_refused() -> None:
    assert ACCESS.refusal(headers(), "secret", is_websocket=True) is not None


def test_secrets_are_long_fit_into_an_address_and_are_not_printed() -> None:
    tokens = {random_token() for _ in range(100)}
    assert len(tokens) == 100 and all(len(token) >= 22 and "/" not in token for token in tokens)
    assert "secret" not in repr(ACCESS) and "secret" in ACCESS.address
