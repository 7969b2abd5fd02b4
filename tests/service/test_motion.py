"""A point of a run in motion: simulated again, in a sandbox, for those who may compute."""

from __future__ import annotations

from service_client import ADDRESS, API, READ_TOKEN
from starlette.testclient import TestClient


def test_a_point_moves_in_a_sandbox_and_only_for_who_may_compute(api, client, coast):
    answer = api.get(f"/runs/{coast}/points/0/motion")
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-security-policy"].startswith(
        "sandbox allow-scripts allow-downloads; default-src 'none'"
    )
    assert 'id="scene-0"' in answer.text
    assert "2.5 deg, -35 N m, 150 rpm (equilibrium)" in answer.text
    jammed = api.get(f"/runs/{coast}/points/1/motion")
    assert jammed.status_code == 422
    assert "the point is jammed" in jammed.json()["errors"][0]["message"]
    link = api.post(f"/runs/{coast}/shares").json()["address"].partition("=")[2]
    for secret in (READ_TOKEN, link):
        asked = TestClient(client.app, ADDRESS, headers={"authorization": f"Bearer {secret}"})
        refused = asked.get(f"{API}/runs/{coast}/points/0/motion")
        assert refused.status_code == 403
        assert asked.get(f"{API}/runs/{coast}/points/0").status_code == 200


def test_the_page_of_a_point_draws_the_joint_to_scale_and_leads_to_its_motion(api, client, settings, coast):
    own = TestClient(client.app, ADDRESS)
    own.get(f"/?token={settings.token}")
    text = own.get(f"{settings.root}/runs/{coast}/points/0").json()["html"]
    assert 'aria-label="The joint to scale: pitch radius 21' in text
    assert f"/api/v1/runs/{coast}/points/0/motion" in text
    assert "/motion" not in own.get(f"{settings.root}/runs/{coast}/points/1").json()["html"]  # it jams
