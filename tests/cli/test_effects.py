"""`catenary effects`: what it lists, and what it leaves to other lists."""

from support.program import MODEL, MODELS

EPISODE = ("--model", MODEL, "--actions", MODELS / "gallery.csv", "--value", "length_m=0.25", "--value", "youngs_modulus_pa=20000")


def test_templates_and_effects_of_blind_tests_are_not_offered(program):
    listed = {row["name"] for row in program.json("effects")}
    assert "tip_mass_kg" in listed
    assert not [name for name in listed if "template" in name or "unlisted" in name or name == "clump_kg"]
    refused = program("effects", "--name", "template_arm_gain")
    assert refused.returncode != 0 and "template_arm_gain" in refused.stderr


def test_an_unlisted_effect_is_sized_at_its_place_and_simulated_by_name(program, tmp_path):
    sized = lambda place: program.json("effects", *EPISODE, "--name", "clump_kg", "--value", f"unlisted_place={place}")[0]
    near, far = sized(0.1), sized(0.8)
    assert near["companions"] == ["unlisted_place"] and near["hook"] == "force"
    assert near["detectable"] > 1.5 * far["detectable"], "a mass near the grip shows less than one near the tip"
    given = ("--effect", "clump_kg=0.02", "--effect", "unlisted_place=0.8", "--effect", "template_arm_gain=0.1")
    said = program.text("simulate", *EPISODE[:4], *given, "--out", tmp_path / "bag")
    assert "clump_kg 0.02" in said and "template_arm_gain 0.1" in said
