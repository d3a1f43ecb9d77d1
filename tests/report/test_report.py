"""`palpate report`: one page that holds everything, loads nothing, and is the same whenever it is made."""

import json
import re
import shutil
import socket
from html.parser import HTMLParser

import pytest
from palpate_report.run_contents import RunContents

HOSTILE = "<script>alert(1)</script>\"'&amp;</pre>{{7*7}}$\\frac$\u2028"


class Page(HTMLParser):
    """Tags with their attributes, texts, and what the element #result holds."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.texts, self.result, self._inside = [], [], "", ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self._inside = tag

    def handle_endtag(self, tag):
        self._inside = ""

    def handle_data(self, data):
        if self._inside == "script":
            self.result += data
        elif self._inside != "style":
            self.texts.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.texts).split())


def read(path):
    return Page(path.read_text(encoding="utf-8"))


@pytest.fixture
def copied(point, tmp_path):
    """A copy of the point run that may be spoilt."""
    return shutil.copytree(point, tmp_path / "run")


@pytest.mark.gate
@pytest.mark.slow
def test_everything_is_on_one_page_the_verdict_first(palpate, copied):
    done = palpate("report", copied)
    assert done.returncode == 0, done.stderr
    file = copied / "report.html"
    assert file.stat().st_size < 500_000
    page = read(file)
    words = [
        "S2, simulated", "good", "one standard uncertainty",
        "Comparison", "kPa", "Flags", "What helps", "Force and model",
        "Lack of fit", "Innovations", "Budget of uncertainty", "share of variance",
        "Calibration and tare", "Streams", "Where it comes from", "versions", "Pipeline as given",
        "Pipeline as run",
    ]  # fmt: skip
    places = [page.text.index(word) for word in words]
    assert places == sorted(places)
    assert sum(tag == "svg" for tag, _ in page.tags) == 5
    assert json.loads(page.result) == json.loads((copied / "result.json").read_text())


@pytest.mark.slow
def test_nothing_is_loaded_and_nothing_is_executed(palpate, copied):
    palpate("report", copied)
    text = (copied / "report.html").read_text()
    page = Page(text)
    assert "default-src 'none'" in text
    for tag, attributes in page.tags:
        assert tag not in ("link", "iframe", "object", "embed", "img", "base", "form")
        assert tag != "script" or attributes == {"type": "application/json", "id": "result"}
        for name, value in attributes.items():
            assert not name.startswith("on")
            assert name not in ("href", "xlink:href", "src") or value.startswith(("#", "data:image/png;base64,"))
    assert not re.search(r"url\((?!#)|@import", text)


@pytest.mark.slow
def test_it_is_the_same_whenever_it_is_made(palpate, copied):
    pages = []
    for name in ("one.html", "two.html"):
        assert palpate("report", copied, "-o", copied / name).returncode == 0
        pages.append((copied / name).read_bytes())
    assert pages[0] == pages[1]


@pytest.mark.slow
def test_texts_of_others_are_no_markup(palpate, copied):
    document = json.loads((copied / "result.json").read_text())
    document["run"]["name"] = HOSTILE
    track = document["tracks"].pop("dr/ekf")
    track["flags"] = [{"code": "odd-code", "message": HOSTILE, "severity": "doubtful"}]
    track["verdict"] = "doubtful"
    track["parameters"][HOSTILE] = track["parameters"]["elasticity"]
    document["tracks"][f"dr/{HOSTILE}"] = track
    document["streams"][HOSTILE] = document["streams"]["rig.tip"]
    document["run"]["inputs"][HOSTILE] = HOSTILE
    (copied / "result.json").write_text(json.dumps(document))
    with (copied / "given.toml").open("a", encoding="utf-8") as file:
        file.write(f"# {HOSTILE}\n")
    table = (copied / "estimates.csv").read_text()
    (copied / "estimates.csv").write_text(table.replace("dr/ekf:", "dr/<script>alert(1)</script>$\\frac$:"))
    other = shutil.copytree(copied, copied.with_name(f"{HOSTILE.replace('/', '')}"))
    for arguments in (["report", copied], ["report", copied, other, "-o", copied / "report.html"]):
        done = palpate(*arguments)
        assert done.returncode == 0, done.stderr
        page = read(copied / "report.html")
        assert [
            attributes for tag, attributes in page.tags if tag == "script" and attributes.get("id") != "result"
        ] == []
        assert "49" not in page.text[:200]
    palpate("report", copied)
    page = read(copied / "report.html")
    assert "<script>alert(1)</script>" in page.text
    assert "{{7*7}}" in page.text
    assert json.loads(page.result)["run"]["name"] == HOSTILE


@pytest.mark.slow
def test_a_run_that_was_killed_says_what_there_is(palpate, copied):
    (copied / "result.json").unlink()
    text = (copied / "estimates.csv").read_text()
    (copied / "estimates.csv").write_text(text[: len(text) * 2 // 3])
    done = palpate("report", copied)
    assert done.returncode == 0, done.stderr
    page = read(copied / "report.html")
    assert page.text.index("no result") < page.text.index("was killed")
    assert "last estimate" in page.text
    assert "palpate replay" in page.text
    assert "kPa" in page.text
    assert sum(tag == "svg" for tag, _ in page.tags) >= 4


@pytest.mark.slow
@pytest.mark.parametrize("kept", [(), ("result.json",), ("pipeline.toml",), ("resolved.toml",), ("estimates.csv",)])
def test_whatever_is_left_of_a_run_is_shown(palpate, copied, kept):
    if kept == ("resolved.toml",):  # of an older run
        (copied / "pipeline.toml").rename(copied / "resolved.toml")
    for path in copied.iterdir():
        if path.is_file() and path.name not in kept:
            path.unlink()
    done = palpate("report", copied)
    if not kept:
        assert done.returncode == 2
        assert "is not a run folder" in done.stderr
        return
    assert done.returncode == 0, done.stderr
    assert read(copied / "report.html").text.startswith(("S2, simulated", "run"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("result.json", '{"tracks": {'),
        ("estimates.csv", ""),
        ("estimates.csv", "time_s,x_m,y_m\n"),
        ("estimates.csv", "\x00\x01,,,\n1,2"),
        ("estimates.csv", "time_s,x_m,y_m\na,b,c\n"),
        ("pipeline.toml", "[[["),
        ("given.toml", "\udcff"),
    ],
)
def test_a_spoilt_file_spoils_nothing_else(palpate, copied, file, content):
    (copied / file).write_text(content, errors="surrogateescape")
    done = palpate("report", copied)
    assert done.returncode == 0, done.stderr
    text = read(copied / "report.html").text
    assert "Comparison" in text or file == "result.json"
    assert ("cannot be read" in text) == ("a,b,c" in content)


def test_no_contact_is_refused_in_words(palpate, runs, tmp_path):
    short = 'run.tracks=["dr/kinematic"]', "trajectory.press.duration=2 s"
    run = runs("filters", *short, "device.rig.specimen.surface=-30 mm")
    palpate("report", run, "-o", tmp_path / "r.html")
    page = read(tmp_path / "r.html")
    assert page.text.index("invalid") < page.text.index("no-contact") < page.text.index("Press deeper")


@pytest.mark.slow
def test_anonymous_names_neither_host_nor_path(palpate, point, tmp_path):
    run = shutil.copytree(point, tmp_path / "jane doe" / "run")
    document = json.loads((run / "result.json").read_text())
    document["run"] |= {"host": "lab-seven", "pipeline": "/home/jane doe/p/point.toml"}
    document["run"]["inputs"]["/data/jane/log.mcap"] = "abc"
    for track in document["tracks"].values():
        track["flags"] = [{"code": "device", "message": "runs/jane/log.mcap on lab-seven", "severity": "note"}]
    (run / "result.json").write_text(json.dumps(document))
    with (run / "given.toml").open("a") as file:
        file.write('\n# path = "/home/jane doe/log.mcap", C:\\Users\\jane\\x.csv at lab-seven\n')
    other = shutil.copytree(run, tmp_path / "other")
    for arguments in (["report", run], ["report", run, other, "-o", run / "report.html"]):
        assert palpate(*arguments, "--anonymous").returncode == 0
        text = (run / "report.html").read_text()
        assert "jane" not in text
        assert "lab-seven" not in text
        assert socket.gethostname() not in Page(text).text.split()
    palpate("report", run)
    assert "lab-seven" in (run / "report.html").read_text()


@pytest.mark.slow
def test_many_runs_are_compared(palpate, runs, tmp_path):
    made = [
        runs("filters", 'run.tracks=["dr/kinematic"]', "trajectory.press.duration=2 s", f"run.seed={k}")
        for k in range(3)
    ]
    for k, run in enumerate(made, 1):
        shutil.copytree(run, tmp_path / f"run-{k}")
    shutil.copytree(made[0], tmp_path / "run-10")
    (tmp_path / "run-10" / "result.json").unlink()
    done = palpate("report", "run-3", "run-10", "run-1", "run-2")
    assert done.returncode == 0, done.stderr
    page = read(tmp_path / "comparison.html")
    assert "4 runs" in page.text
    assert "3 of 4" in page.text
    assert [page.text.index(f" run-{k} ") for k in (1, 2, 3, 10)] == sorted(
        page.text.index(f" run-{k} ") for k in (1, 2, 3, 10)
    )
    assert "was killed" in page.text
    assert "run.seed is 1, was 0" in page.text
    grouped = palpate("report", "--group", "a=run-[12]", "--group", "b=run-[23]", "-o", "groups.html")
    assert grouped.returncode == 0, grouped.stderr
    assert "Differences between groups" in read(tmp_path / "groups.html").text


@pytest.mark.slow
def test_sites_are_on_a_map(palpate, point, tmp_path):
    for k in range(3):
        run = shutil.copytree(point, tmp_path / f"site-{k}")
        lines = (run / "estimates.csv").read_text().splitlines()
        names = lines[0].split(",")
        rows = [line.split(",") for line in lines[1:]]
        for row in rows:
            row[names.index("x_m")], row[names.index("y_m")] = f"{5e-3 * k}", "0"
        (run / "estimates.csv").write_text("\n".join([lines[0], *map(",".join, rows)]) + "\n")
    assert palpate("report", "site-0", "site-1", "site-2").returncode == 0
    assert "Where the runs were made" in read(tmp_path / "comparison.html").text
    shutil.copytree(tmp_path / "site-0", tmp_path / "again")
    assert palpate("report", "site-0", "again").returncode == 0
    assert "Where the runs were made" not in read(tmp_path / "comparison.html").text


@pytest.mark.slow
def test_a_run_writes_its_report_or_says_how(palpate, point_pipeline, tmp_path):
    short = ["--set", "trajectory.press.duration=1 s", "--set", 'run.tracks=["dr/ekf"]']
    plain = palpate("run", point_pipeline, "--out", "plain run", *short)
    advice = ["share: palpate report 'plain run'", "why ±: palpate report budget 'plain run'"]
    assert plain.stdout.splitlines()[-2:] == advice
    assert not (tmp_path / "plain run" / "report.html").exists()
    done = palpate("run", point_pipeline, "--out", "told", *short, "--report")
    assert done.stdout.splitlines()[-1] == "report: told/report.html"
    assert (tmp_path / "told" / "report.html").is_file()
    asked = palpate("run", point_pipeline, "--out", "asked", *short, "--set", "run.report=true", "--json")
    assert json.loads(asked.stdout)["tracks"]
    assert (tmp_path / "asked" / "report.html").is_file()


@pytest.mark.slow
def test_a_section_that_fails_says_so(monkeypatch, point):
    from palpate import ReportSection
    from palpate_engine import registry
    from palpate_report.run_contents import RunContents
    from palpate_report.run_report import page_of

    broken = {**registry.offers("palpate_report_sections", ReportSection), "broken": ReportSection("math:sqrt")}
    offers = registry.offers
    monkeypatch.setattr(registry, "offers", lambda hook, root: broken if root is ReportSection else offers(hook, root))
    text = Page(page_of(RunContents.read(point))).text
    assert "This section could not be made: TypeError" in text
    assert "Pipeline as run" in text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "name at least one run folder"),
        (["nowhere"], "is not a run folder"),
        (["RUN", "--track", "dr/efk"], "did you mean 'dr/ekf'"),
        (["RUN", "-o", "pipeline.toml"], "ends in .html"),
        (["--group", "soft"], "NAME=PATTERN"),
        (["--group", "soft=none*"], "nothing matches"),
        (["RUN", "-o", "no/such/page.html"], "cannot write"),
    ],
)
def test_a_mistake_is_one_message(palpate, point, arguments, words):
    done = palpate("report", *[point if word == "RUN" else word for word in arguments])
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_pdf_says_what_it_needs_or_is_made(palpate, copied, monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: None)
    done = palpate("report", copied, "--pdf")
    assert done.returncode == 2
    assert "Chromium" in done.stderr
    monkeypatch.undo()
    if not any(map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))):
        pytest.skip("neither Chromium nor Chrome is here")
    done = palpate("report", copied, "--pdf")
    assert done.returncode == 0, done.stderr
    assert (copied / "report.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.slow
def test_a_section_of_a_report_sees_what_result_json_has(point):
    result = RunContents.read(point).result()
    document = json.loads((point / "result.json").read_text())
    assert result.table() == document
    assert any(track["conditions"] for track in document["tracks"].values())
    for name, track in result.tracks.items():
        values = {**track.parameters, **{value.name: value.found for value in track.derived}}
        table = document["tracks"][name]
        assert [condition.table(values) for condition in track.conditions] == table["conditions"]
        assert [flag.table() for flag in track.immaterial] == table.get("immaterial", [])
