"""Two resolved pipelines that should be one."""

import pytest
from palpate_kit.runs.pipeline_diff import differences

BEFORE = '[run]\nseed = 0\n\n[alignment]\ntare = "none"\n'


@pytest.mark.parametrize(
    ("now", "words"),
    [
        (BEFORE, ""),
        (BEFORE.replace("seed = 0", "seed = 0\ndistributions = []"), ""),  # a key that a later version has
        (BEFORE.replace("seed = 0", "seed = 1"), "run.seed is 1, was 0"),
        (BEFORE.replace("seed = 0", 'seed = 0\nplugins = ["own.py"]'), "run.plugins is ['own.py'], was not given"),
    ],
)
def test_a_setting_that_differs_is_named(now, words):
    assert differences(now, BEFORE) == words
