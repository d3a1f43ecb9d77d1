"""Damage to the files of a run folder, by seed: keys, values, cells, bytes, and files that are gone."""

import json

VALUES = (None, True, -1, 0, 1e308, "", "x", "\0", [], {}, [[]], {"x": 1}, 10**400, float("nan"), [None], -(10**9))
CELLS = (b"", b"x", b"nan", b"inf", b"-1", b"1e400", b"\xff")
PIECES = (b"\xff\xfe", b"nan", b"1e999", b",,,", b"\n\n", b"\0", b'"')


def places(item, path=()):
    """Every place in a document."""
    inner = item.items() if isinstance(item, dict) else enumerate(item) if isinstance(item, list) else ()
    for key, value in inner:
        yield (*path, key)
        yield from places(value, (*path, key))


def damaged_document(raw, dice):
    """A key gone, another value, or another name, once or twice."""
    document = json.loads(raw)
    for _ in range(dice.choice([1, 1, 2])):
        *path, key = dice.choice(list(places(document)))
        table = document
        for step in path:
            table = table[step]
        how = dice.randrange(3)
        if how == 0:
            del table[key]
        elif how == 1:
            table[key] = dice.choice(VALUES)
        elif isinstance(table, dict):
            table[f"{key}x"] = table.pop(key)
        else:
            table.append(table[key])
    return json.dumps(document).encode()


def damaged_table(raw, dice):
    """Another cell; at times another name of a column."""
    lines = raw.split(b"\n")
    row = dice.randrange(len(lines))
    cells = lines[row].split(b",")
    cells[dice.randrange(len(cells))] = dice.choice(CELLS)
    lines[row] = b",".join(cells)
    if dice.random() < 0.3:
        lines[0] = lines[0].replace(b":status", b":statu", 1)
    return b"\n".join(lines)


def damaged_bytes(raw, dice):
    """Bytes that are other ones, more, fewer, zero, or cut off."""
    raw = bytearray(raw)
    for _ in range(dice.choice([1, 3, 20])):
        at, how = dice.randrange(len(raw) + 1), dice.randrange(5)
        if how == 0 and at < len(raw):
            raw[at] = dice.randrange(256)
        elif how == 1:
            del raw[at : at + dice.choice([1, 10, 1000])]
        elif how == 2:
            raw[at:at] = dice.choice(PIECES)
        elif how == 3:
            raw[at : at + 8] = bytes(8)
        elif how == 4:
            del raw[at:]
    return bytes(raw)


def damage(folder, dice, patterns):
    """Damage one of the files of a run folder that match, its result most often; what was done, in words."""
    files = sorted(file for pattern in patterns for file in folder.rglob(pattern) if file.is_file())
    file = dice.choice([file for file in files if file.name == "result.json"] * 3 + files)
    raw, kind = file.read_bytes(), dice.random()
    if kind < 0.12:
        file.unlink()
        if kind < 0.04:
            file.mkdir()
        return f"{file.name} gone"
    if kind < 0.16:
        file.write_bytes(b"")
        return f"{file.name} empty"
    change = damaged_bytes
    if kind < 0.8:
        change = {".json": damaged_document, ".csv": damaged_table}.get(file.suffix, damaged_bytes)
    file.write_bytes(change(raw, dice))
    return f"{file.name} {change.__name__}"
