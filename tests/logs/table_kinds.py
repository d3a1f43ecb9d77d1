"""Kinds of tables in which people have their presses, five files of each, of simulated presses with a sphere of 3 mm.

A source names the program whose public files have this form, and where that form is described; the numbers and the
names of samples and people are made up here.
"""

import gzip
import io
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime, timedelta

import numpy as np

RADIUS, RATE, FILES = 3e-3, 250, 5  # [m], [Hz], of each kind


@dataclass(frozen=True)
class Press:
    """Time [s], height of the tip above where it began [m], force [N] of a press on some 100 kPa."""

    t: np.ndarray
    z: np.ndarray
    f: np.ndarray


def press(seed, n=400):
    random = np.random.default_rng(seed)
    t = np.arange(n) / RATE
    depth = (3.6e-3 + 1e-4 * seed) * np.sin(np.pi * t / t[-1]) - 0.8e-3
    contact, speed = np.maximum(depth, 0.0), np.gradient(depth, t)
    f = 16 / 9 * 1e5 * (1 + 0.1 * seed) * np.sqrt(RADIUS) * contact**1.5 + 8 * 300 * np.sqrt(RADIUS * contact) * speed
    return Press(t, -depth + 2e-6 * random.standard_normal(n), np.maximum(f, 0.0) + 0.01 * random.standard_normal(n))


def cell(x, form, decimal, thousands):
    text = f"{x:,{form}}" if thousands else f"{x:{form}}"
    return text.translate(str.maketrans({",": thousands, ".": decimal})) if thousands else text.replace(".", decimal)


def table(columns, sep=",", decimal=".", thousands="", above=(), header=True, units=None, quote="", end="\n", tail=""):
    """A table as text; columns are (name, numbers or texts, format)."""
    rows = [
        [quote + (cell(x, form, decimal, thousands) if form else x) + quote for x in values]
        for _, values, form in columns
    ]
    lines = [*above]
    lines += [sep.join(f"{quote}{name}{quote}" for name, _, _ in columns) + tail] if header else []
    lines += [sep.join(f"{quote}{unit}{quote}" for unit in units) + tail] if units else []
    lines += [sep.join(row) + tail for row in zip(*rows, strict=True)]
    return end.join(lines) + end


def plain(p, names=("time_s", "force_N", "height_mm"), f=1.0, z=1e3, t=1.0, forms=(".4f", ".4f", ".4f")):
    return [(name, x, form) for name, x, form in zip(names, (t * p.t, f * p.f, z * p.z), forms, strict=True)]


def end(v):
    return "\r\n" if v % 2 else "\n"


def sign(v):
    return -1 if v % 2 else 1


@dataclass(frozen=True)
class Kind:
    """A form of files; `write` takes a press and the number of the file, and returns bytes."""

    name: str
    write: Callable
    source: str = ""
    suffix: str = ".csv"
    timing: str = ""  # the rate that must be said, since the file states no time
    answers: dict = field(default_factory=dict)  # what must be said besides, by key of the device
    part: str = "whole"  # of the press that is read: whole, approach, retract


def encoded(text, encoding="utf-8"):
    return text.encode(encoding)


# ---------------------------------------------------------------- after files of programs


def instron(p, v):
    above = [
        "Specimen properties : Geometry,Circular",
        'Specimen properties : Diameter,"14,0",mm',
        f"Specimen label,gel {v}",
        "",
    ]
    columns = [
        ("Time", p.t, ".3f"),
        ("Extension", -1e3 * p.z, ".4f"),
        ("Load", p.f, ".4f"),
        ("Compressive stress", p.f / 154, ".5f"),
    ]
    head = ["Time,Extension,Load,Compressive stress", "(s),(mm),(N),(MPa)"]
    body = table(columns, decimal=",", quote='"', header=False)
    return encoded("\n".join([*above, *head, ""]) + body)


def instron_points(p, v):
    above = ["Dimension : Length,50,mm", "Dimension : Width,20,mm", "Dimension : Thickness,12.4,mm", ""]
    columns = [
        ("Time", p.t, ".5f"),
        ("Extension", 1e3 * p.z, ".5f"),
        ("Load", -p.f, ".5f"),
        ("Tensile strain", -p.z / 0.05, ".5f"),
    ]
    return encoded(table(columns, above=above, units=["(sec)", "(mm)", "(N)", "(mm/mm)"], end=end(v)))


def bose(p, v):
    above = [f'"C:\\data\\gel{v}.csv"\0', '"Data Acquisition"']
    n = len(p.t)
    columns = [
        ("Points", np.arange(1, n + 1), "d"),
        ("Elapsed Time ", p.t, ".4f"),
        ("Scan Time ", p.t, ".4f"),
        ("Disp     ", 1e3 * p.z, ".5f"),
        ("Load 1   ", -p.f, ".5f"),
    ]
    head = [
        '"Points","Elapsed Time ","Scan Time ","Disp     ","Load 1   ",',
        '"","Sec      ","Sec      ","mm       ","N        ",',
    ]
    return encoded("\r\n".join([*above, *head, ""]) + table(columns, header=False, tail=",", end="\r\n"))


def zwick(p, v):
    above = ["Probenbezeichnung;Gel A", "Prüfer;A. B.", f"Vorkraft;{v},0;N", ""]
    columns = [
        ("Prüfzeit", p.t, ".4f"),
        ("Standardweg", -1e3 * p.z, ".5f"),
        ("Standardkraft", p.f, ".5f"),
        ("Traverse abs.", 50 - 1e3 * p.z, ".2f"),
    ]
    return encoded(table(columns, ";", ",", above=above, units=["s", "mm", "N", "mm"], end="\r\n"), "cp1252")


def mts(p, v):
    columns = [
        ("Index", np.arange(len(p.t)), "d"),
        ("Time (sec)", p.t, ".4f"),
        ("Load (N)", p.f, ".4f"),
        ("Crosshead (mm)", 40 + 1e3 * p.z, ".5f"),
        ("Stress (kPa)", p.f * 7, ".3f"),
    ]
    return encoded(table(columns, end=end(v)))


def texture_analyser(p, v):
    columns = [("Force", p.f / 9.80665e-3, ".3f"), ("Distance", -1e3 * p.z, ".4f"), ("Time", p.t, ".4f")]
    return encoded(table(columns, "\t" if v % 2 else ",", above=[f"gel {v}"], units=["g", "mm", "sec"], end="\r\n"))


def cellscale(p, v):
    n = len(p.t)
    columns = [
        ("SetName", [f"set{v}"] * n, ""),
        ("Cycle", ["1-Compress"] * n, ""),
        ("Time_S", p.t, ".4f"),
        ("Size_mm", 12 + 1e3 * p.z, ".2f"),
        ("Displacement_mm", -1e3 * p.z, ".5f"),
        ("Force_N", p.f, ".5f"),
    ]
    return encoded(table(columns, ",", end=end(v)))


def piuma(p, v):
    mark = "," if v % 2 else "."
    above = [
        "Date\t12/05/2024",
        "Status\tDone",
        f"Tip radius (um)\t3000{mark}0",
        f"k (N/m)\t4{mark}5",
        "",
        f"D[Z1] (nm)\t0{mark}0\tt[1] (s)\t1{mark}0",
        f"D[Z2] (nm)\t3000{mark}0\tt[2] (s)\t2{mark}0",
        "",
    ]
    depth = -1e9 * p.z
    columns = [
        ("Time (s)", p.t, ".6f"),
        ("Load (uN)", 1e6 * p.f, ".2f"),
        ("Indentation (nm)", depth, ".2f"),
        ("Cantilever (nm)", 1e4 * p.f, ".2f"),
        ("Piezo (nm)", depth + 1e4 * p.f, ".2f"),
        ("Auxiliary", 0 * p.t, ".2f"),
    ]
    return encoded(table(columns, "\t", mark, above=above))


def hysitron(p, v):
    columns = [("Depth (nm)", -1e9 * p.z, ".3f"), ("Load (µN)", 1e6 * p.f, ".3f"), ("Time (s)", p.t, ".6f")]
    above = ["", f"Number of Points = {len(p.t)}", ""]
    return encoded(table(columns, "\t", above=above, end="\r\n"), "latin-1" if v % 2 else "utf-8")


def labview(p, v):
    mark = "," if v % 2 else "."
    n = len(p.t)
    above = [
        "LabVIEW Measurement",
        "Writer_Version\t2",
        "Separator\tTab",
        f"Decimal_Separator\t{mark}",
        "Multi_Headings\tNo",
        "Operator\tAB",
        "Date\t2024/05/22",
        f"Time\t17:18:18{mark}9389",
        "***End_of_Header***",
        "",
        "Channels\t2",
        f"Samples\t{n}\t{n}",
        "Date\t2024/05/22\t2024/05/22",
        f"Time\t17:18:18{mark}93\t17:18:18{mark}93",
        "Y_Unit_Label\tN\tmm",
        "X_Dimension\tTime\tTime",
        f"X0\t0{mark}0E+0\t0{mark}0E+0",
        f"Delta_X\t0{mark}004\t0{mark}004",
        "***End_of_Header***",
        "X_Value\tForce_N\tHeight_mm\tComment",
    ]
    return encoded("\n".join([*above, ""]) + table(plain(p, forms=(".4f", ".6f", ".6f")), "\t", mark, header=False))


def vernier(p, v):
    columns = plain(
        p, ("Latest: Time (s)", "Latest: Force (N)", "Latest: Position (m)"), z=1.0, forms=(".4f", ".4f", ".7f")
    )
    return encoded(table(columns, *((";", ",") if v % 2 else (",", "."))), "utf-8-sig")


def rostopic(p, v):
    n = len(p.t)
    stamps = [f"{1_700_000_000_000_000_000 + round(1e9 * x)}" for x in p.t]
    columns = [
        ("%time", stamps, ""),
        ("field.header.seq", np.arange(n), "d"),
        ("field.header.stamp", stamps, ""),
        ("field.header.frame_id", ["tool0"] * n, ""),
        ("field.wrench.force.x", 0.01 * np.cos(np.arange(n) * 1.7), ".6f"),
        ("field.wrench.force.y", 0.01 * np.sin(np.arange(n) * 2.3), ".6f"),
        ("field.wrench.force.z", sign(v) * p.f, ".6f"),
        ("field.pose.position.z", 0.3 + p.z, ".7f"),
    ]
    return encoded(table(columns))


def rtde(p, v):
    n = len(p.t)
    still = np.zeros(n)
    columns = [("timestamp", 5000 + p.t, ".4f")]
    columns += [(f"actual_TCP_pose_{i}", 0.2 + p.z if i == 2 else still + 0.1 * i, ".7f") for i in range(6)]
    columns += [(f"actual_TCP_force_{i}", sign(v) * p.f if i == 2 else still, ".6f") for i in range(6)]
    return encoded(table(columns, " "))


def plotjuggler(p, v):
    columns = plain(
        p,
        ("__time", "/ft_sensor/wrench/force/z", "/tcp/pose/position/z"),
        z=1.0,
        f=sign(v),
        forms=(".4f", ".5f", ".8f"),
    )
    return encoded(table(columns))


def savetxt(p, v):
    out = io.StringIO()
    header = "time [s] force [N] height [mm]" if v % 2 else "presses of Tuesday\ntime[s] force[N] height[mm]"
    np.savetxt(out, np.column_stack([p.t, p.f, 1e3 * p.z]), header=header)
    return encoded(out.getvalue())


def pandas(p, v):
    columns = [("", np.arange(len(p.t)), "d"), *plain(p, ("time [ms]", "force [mN]", "height [um]"), 1e3, 1e6, 1e3)]
    return encoded(table(columns))


def unicode_text(p, v):
    return encoded(
        table(plain(p, ("Time (s)", "Load (N)", "Height (µm)"), z=1e6), "\t", "," if v % 2 else ".", end="\r\n"),
        "utf-16",
    )


def devotrans(p, v):
    columns = [("Zaman (s)", p.t, ".4f"), ("Kuvvet (N)", p.f, ".4f"), ("Uzama (mm)", -1e3 * p.z, ".5f")]
    return encoded(table(columns, ";", ",", above=["Numune: jel", "Operatör: A"], end=end(v)))


# ---------------------------------------------------------------- forms that any laboratory has


def german(p, v):
    return encoded(
        table(plain(p, ("Zeit [s]", "Kraft [N]", "Weg [µm]"), z=-1e6), ";", ",", end="\r\n"),
        "latin-1" if v % 2 else "cp1252",
    )


def commented(mark, sep=","):
    def write(p, v):
        above = [f"{mark} measured by A. B. on 2024-05-01", f"{mark} probe diameter: 6 mm", f"{mark}"]
        text = table(plain(p, ("time (s)", "force (N)", "height (mm)")), sep, above=above, end=end(v))
        lines = text.split(end(v))
        return encoded(end(v).join([*lines[:200], f"{mark} paused", *lines[200:]]))

    return write


def titled(p, v):
    above = [f"Indentation of gel {v}", "second try, new tip", ""]
    return encoded(table(plain(p, ("time (s)", "force (N)", "height (mm)")), above=above[: 1 + v % 3], end=end(v)))


def metadata(p, v):
    above = [
        "Sample: silicone 00-30",
        "Operator: A. B.",
        "Tip diameter: 6 mm",
        "Date: 2024-05-01 12:00:00",
        "Sampling rate: 250 Hz",
        "",
    ]
    return encoded(
        table(plain(p, ("Time, s", "Force, mN", "Height, um"), 1e3, 1e6), ";", above=above[v % 2 :], end=end(v))
    )


def units_row(p, v):
    return encoded(
        table(
            plain(p, ("Time", "Force", "Height"), 1e3, 1e2),
            ";" if v % 2 else ",",
            units=["[s]", "[mN]", "[cm]"],
            end=end(v),
        )
    )


def two_headers(p, v):
    above = ["Clock,Sensor,Robot", "Time,Force,Height"]
    return encoded("\n".join([*above, "s,N,mm", ""]) + table(plain(p), header=False))


def slashed(p, v):
    return encoded(table(plain(p, ("t / ms", "F / N", "z / mm"), t=1e3, f=sign(v))))


def in_words(p, v):
    return encoded(table(plain(p, ("Time in ms", "Force in mN", "Position in mm"), 1e3, t=1e3), ";", ",", end=end(v)))


def thousands(p, v):
    columns = plain(p, ("Time (s)", "Force (mN)", "Height (um)"), 1e3, 1e6, forms=(".4f", ".2f", ".2f"))
    return encoded(table(columns, thousands=",", quote='"', end=end(v)))


def german_thousands(p, v):
    columns = plain(p, ("Zeit (s)", "Kraft (mN)", "Höhe (µm)"), 1e3, 1e6, forms=(".4f", ".2f", ".2f"))
    return encoded(table(columns, ";", ",", ".'"[v % 2]), "cp1252")


def no_header(p, v):
    return encoded(table(plain(p, f=sign(v)), header=False, end=end(v)))


def no_time(p, v):
    return encoded(table(plain(p)[1:], end=end(v)))


def clock(p, v):
    begin = datetime(2024, 5, 1, 23, 59, 59) if v % 2 else datetime(2024, 5, 1, 12, 0, 1)
    stamps = [begin + timedelta(seconds=float(x)) for x in p.t]
    texts = [f"{stamp:%H:%M:%S}.{stamp.microsecond // 1000:03d}" for stamp in stamps]
    columns = [
        ("Date", [f"{stamp:%Y-%m-%d}" for stamp in stamps], ""),
        ("Time", texts, ""),
        *plain(p, ("", "Load (N)", "Disp (mm)"))[1:],
    ]
    return encoded(table(columns))


def dated(p, v):
    begin = datetime(2024, 5, 1, 12, 0, 1)
    stamps = [begin + timedelta(seconds=float(x)) for x in p.t]
    if v % 2:
        texts = [f"{stamp:%d.%m.%Y %H:%M:%S},{stamp.microsecond // 1000:03d}" for stamp in stamps]
        return encoded(table([("Zeit", texts, ""), *plain(p, ("", "Kraft (N)", "Weg (mm)"))[1:]], ";", ","))
    texts = [stamp.isoformat(timespec="microseconds") for stamp in stamps]
    return encoded(table([("timestamp", texts, ""), *plain(p)[1:]]))


def kilograms(p, v):
    unit, force = (("kgf", 9.80665), ("kg", 9.80665), ("gf", 9.80665e-3), ("lbf", 4.4482216152605), ("N", 1.0))[v]
    return encoded(
        table(plain(p, ("Time (s)", f"Load ({unit})", "Stroke (mm)"), 1 / force, -1e3, forms=(".4f", ".6f", ".4f")))
    )


def volts(p, v):
    names = ("time (s)", "load cell (V)", "height (mm)") if v % 2 else ("time (s)", "Force [mV]", "height (mm)")
    return encoded(table(plain(p, names, 1 / 25 if v % 2 else 1e3 / 25, forms=(".4f", ".6f", ".4f"))))


def texts(p, v):
    n = len(p.t)
    columns = [("stage", ["press"] * n, ""), *plain(p), ("", [""] * n, ""), ("remark", ["", "ok"] * (n // 2), "")]
    return encoded(table(columns, ";" if v % 2 else ",", end=end(v)))


def halves(p):
    top = len(p.t) // 2
    return Press(p.t[:top], p.z[:top], p.f[:top]), Press(p.t[top:], p.z[top:], p.f[top:])


def two_ways(p, v):
    one, other = halves(p)
    names = ("Approach Height (mm)", "Approach Force (N)", "Retract Height (mm)", "Retract Force (N)")
    values = (1e3 * one.z, one.f, 1e3 * other.z[::-1], other.f[::-1])
    columns = [(name, x, ".4f") for name, x in zip(names, values, strict=True)]
    if v % 2:
        above = ["Approach,,Retract,", "Height (mm),Force (N),Height (mm),Force (N)"]
        return encoded("\n".join([*above, ""]) + table(columns, header=False))
    return encoded(table(columns))


def one_way(p, v):
    return encoded(table(plain(halves(p)[0], ("time (s)", "force (N)", "height (mm)"))))


def workbook(p, v):
    from openpyxl import Workbook

    book = Workbook()
    sheet = book.active
    if v % 2:
        sheet.append(["notes of the day"])
        sheet = book.create_sheet("data")
    for row in [["Sample", "gel"], ["Tip diameter", 6, "mm"], []] if v > 1 else []:
        sheet.append(row)
    begin = datetime(2024, 5, 1, 12, 0, 1)
    sheet.append(["Time", "Load", "Height"] if v == 4 else ["Time (s)", "Load (N)", "Height (mm)"])
    if v == 4:
        sheet.append([None, "N", "mm"])
    for t, f, z in zip(p.t.tolist(), p.f.tolist(), (1e3 * p.z).tolist(), strict=True):
        sheet.append([(begin + timedelta(seconds=t)) if v == 4 else t, f, z])
    out = io.BytesIO()
    book.save(out)
    return out.getvalue()


def packed(p, v):
    return gzip.compress(titled(p, v))


MECHANA = "github: mechana, a package that reads it"
KINDS = [
    Kind("instron-bluehill-commas", instron, "Instron Bluehill, raw data; a page on converting them, github"),
    Kind("instron-bluehill", instron_points, f"Instron Bluehill; {MECHANA}"),
    Kind("bose-wintest", bose, f"Bose ElectroForce WinTest; {MECHANA}"),
    Kind("zwick-testxpert", zwick, "Zwick testXpert; names in several programs of github"),
    Kind("mts-testworks", mts, "MTS TestWorks; names of columns in github"),
    Kind(
        "texture-analyser",
        texture_analyser,
        "Stable Micro Systems Exponent: force in g, distance, time in rows of units",
    ),
    Kind("cellscale", cellscale, "CellScale MicroTester/UStretch: the output columns of its settings file, github"),
    Kind("optics11-piuma", piuma, "Optics11 Piuma/Chiaro; several readers in github", ".txt"),
    Kind(
        "hysitron", hysitron, "Hysitron/Bruker indenters: Depth (nm), Load (µN), Time (s); a reader in github", ".txt"
    ),
    Kind("labview-lvm", labview, "LabVIEW measurement file; several readers in github", ".lvm"),
    Kind("vernier", vernier, "Vernier Graphical Analysis: 'Latest: ...'; github"),
    Kind("rostopic-echo", rostopic, "ROS 1, rostopic echo -p; github"),
    Kind("ur-rtde", rtde, "Universal Robots RTDE client, record.py; github"),
    Kind("plotjuggler", plotjuggler, "PlotJuggler, export to CSV"),
    Kind("numpy-savetxt", savetxt, "numpy.savetxt with a header", ".txt"),
    Kind("pandas", pandas, "pandas.DataFrame.to_csv with its index"),
    Kind("excel-unicode-text", unicode_text, "Microsoft Excel, Unicode text", ".txt"),
    Kind("devotrans", devotrans, "Devotrans: Kuvvet; github"),
    Kind("german", german),
    Kind("comments-hash", commented("#")),
    Kind("comments-percent", commented("%", "\t")),
    Kind("comments-slashes", commented("//")),
    Kind("comments-semicolon", commented(";")),
    Kind("title-lines", titled),
    Kind("metadata", metadata),
    Kind("units-row", units_row),
    Kind("two-headers", two_headers),
    Kind("units-behind-slash", slashed),
    Kind("units-in-words", in_words),
    Kind("thousands", thousands),
    Kind("thousands-german", german_thousands),
    Kind("no-header", no_header),
    Kind("no-time", no_time, timing="250 Hz"),
    Kind("clock", clock),
    Kind("date-and-time", dated),
    Kind("kilograms", kilograms),
    Kind("volts", volts, answers={"columns.force.scale": lambda v: 25.0 if v % 2 else 0.025}),
    Kind("text-columns", texts),
    Kind("two-ways", two_ways, timing="250 Hz", part="approach"),
    Kind("one-way", one_way, part="approach"),
    Kind("workbook", workbook, suffix=".xlsx"),
    Kind("packed", packed, suffix=".csv.gz"),
]
