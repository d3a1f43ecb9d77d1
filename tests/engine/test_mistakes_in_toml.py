"""Mistakes of the form: a table without a name, text that is no TOML."""

import pytest
from palpate import ConfigurationError
from palpate_engine.config import load_pipeline


def test_a_part_without_a_name_is_told_how_to_name_it(point_pipeline):
    point_pipeline.write_text(point_pipeline.read_text().replace("[estimator.ekf]", "[estimator]"))
    with pytest.raises(ConfigurationError, match=r"\[estimator\]: has no name: write \[estimator\.NAME\], such as"):
        load_pipeline(point_pipeline)


def test_text_that_is_no_toml_is_shown_with_a_caret(point_pipeline):
    text = point_pipeline.read_text().replace('bias = "4 mm"', "bias = 4 mm")
    point_pipeline.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        load_pipeline(point_pipeline)
    head, line, caret = str(caught.value).splitlines()
    assert f"point.toml:{text.splitlines().index('bias = 4 mm') + 1}: not TOML" in head
    assert "a quantity with a unit is a text" in head
    assert line == "  bias = 4 mm"
    assert caret.index("^") == line.index(" mm") + 1


def test_a_part_whose_inner_table_is_wrong_is_one_mistake(tmp_path):
    """The rest of it, taken alone, would have no tip, and the alignment would be blamed for that."""
    file = tmp_path / "joints.toml"
    file.write_text(
        '[device.ros]\ntype = "ros2"\n'
        '[device.ros.kinematics]\ntopic = "/joint_states"\nrobot = "ur4"\ntcp = ["0 mm", "0 mm", "0 mm"]\n'
        '[device.ros.signals]\nforce = { topic = "/wrench", field = "wrench.force.z", unit = "N" }\n'
        '[alignment]\nforce = "ros.wrench.force"\nposition = "ros.tip.z"\ntip_mass = "140 g"\n'
    )
    with pytest.raises(ConfigurationError) as caught:
        load_pipeline(file)
    assert "kinematics.robot: 'ur4' is not allowed" in str(caught.value)
    assert "ros.tip.z" not in str(caught.value)
