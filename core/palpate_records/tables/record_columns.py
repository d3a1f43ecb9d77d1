"""Records of one table by its columns: tables side by side, or a column that names the record of each row."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import islice

from palpate import printable

from palpate_records.messages.readings import si_unit
from palpate_records.tables.cells import number
from palpate_records.tables.csv_names import exact_role, role_by_words, unit_of, words_of
from palpate_records.tables.csv_sheet import Sheet
from palpate_records.tables.table_record import TableRecord
from palpate_records.tables.table_text import bounded_lines, open_text

MAX_RECORD_NAME = 40  # characters: a choice
PRESS_ROLES = ("force", "position")
_MIN_USUAL_ROWS = 20  # of a record that a column names, the median: a choice
_NAMING_WORDS = (
    "point points site press specimen specimens sample probe trial indent slot gel curve replicate probekörper messung "
    "punkt muestra numune échantillon"
)
# Words of a second column of one quantity, or of a component of a vector.
_OTHER_WORDS = (
    "raw filtered smooth smoothed corrected target actual desired setpoint command commanded cmd reference measured "
    "approach retract extend loading unloading left right x y z rx ry rz tcp joint robot"
)
NAMING = frozenset(_NAMING_WORDS.split())
_OTHER = frozenset(_OTHER_WORDS.split())
_ROLE_BY_DIMENSION = {"N": "force", "m": "position", "s": "time"}
_BRACKETS = re.compile(r"[\[(][^\])]*[\])]")


def records_side_by_side(sheet: Sheet) -> list[TableRecord]:
    """Return the records of tables side by side, by the labels in their names; columns without a label belong to all.

    A record is one press (force over position) in a file of several; a label is as "2" in "force 2". Each has one force
    and one position of its own. Labels of several columns of one quantity, or of the components of a vector, do not
    count.
    """
    labels_and_names = [_label_and_name(sheet, column) for column in range(len(sheet.names))]
    shared_columns = [column for column, (label, _) in enumerate(labels_and_names) if not label]
    labels = list(dict.fromkeys(label for label, _ in labels_and_names if label))
    # A force or position without a label would be that of all records.
    if len(labels) < 2 or any(column_role(sheet, column) in PRESS_ROLES for column in shared_columns):
        return []
    are_elements = labels == [str(index) for index in range(len(labels))]
    if are_elements or any(_is_other_label(label) for label in labels):
        return []
    records = []
    for label in labels:
        own_columns = [column for column, (other, _) in enumerate(labels_and_names) if other == label]
        roles = Counter(column_role(sheet, column) for column in own_columns)
        if all(roles[role] == 1 for role in PRESS_ROLES):
            columns = tuple(sorted([*shared_columns, *own_columns]))
            records.append(_record_of_columns(label, columns, [name for _, name in labels_and_names]))
    return records if len(records) > 1 else []


def _record_of_columns(label: str, columns: tuple[int, ...], all_names: Sequence[str]) -> TableRecord:
    """Return a record of some columns of a table; their names, or their numbers if two names are the same."""
    names = tuple(all_names[column] for column in columns)
    if len({*names}) < len(names):
        names = tuple(map(str, columns))
    return TableRecord(label[:MAX_RECORD_NAME], cells=columns, names=names)


def _is_other_label(label: str) -> bool:
    """Return True if the words of a label are those of another column of a quantity, and not of a record."""
    words = {*words_of(label)}
    return bool(_OTHER & words) and not NAMING & words


def _label_and_name(sheet: Sheet, column: int) -> tuple[str, str]:
    """Return the label of a column, and its name without the label; "" if it has none.

    A label is the title of the column's group, its number among columns of one name, or the words of its name besides
    quantity and unit, if these end in a digit or are a single letter. `sheet` is the text table.
    """
    name = sheet.names[column]
    group = sheet.layout.groups[column] if column < len(sheet.layout.groups) else ""
    if group:
        return printable(group), name.removeprefix(group).strip() or name
    if sheet.names.count(name) > 1:
        return str(sheet.names[:column].count(name) + 1), name
    role = column_role(sheet, column)
    unit = sheet.unit(column)
    if role is None or (unit is None and not NAMING & {*words_of(name)}):
        return "", name
    label_words = _words_beyond_quantity(name, unit, role)
    label = " ".join(label_words)
    is_axis = len(label_words) == 1 and label_words[0].lower() in ("x", "y", "z")
    if is_axis or not re.fullmatch(r".*\d|[A-Za-z]", label):
        return "", name
    # The name that the columns of all records share: without the words of the label.
    plain_name = name
    for text in label_words:
        plain_name = re.sub(rf"[\s_\-:,]*(?<![^\W_]){re.escape(text)}(?![^\W_])", " ", plain_name, count=1)
    return label, " ".join(plain_name.split()).strip("_- ")


def _words_beyond_quantity(name: str, unit: str | None, role: str) -> list[str]:
    """Return the words of a name without its unit, and without those of its quantity, also with a number behind."""
    bare_name = _BRACKETS.sub(" ", name)
    if unit:
        bare_name = re.sub(rf"[\s_/,]*{re.escape(unit)}\s*$", "", bare_name)
    texts = re.split(r"[\s_\-:,]+", bare_name)
    return [text for text in texts if text and role not in (exact_role(text), role_by_words(text))]


def column_role(sheet: Sheet, column: int) -> str | None:
    """Return the role of a column by its unit, else by its name; "other" for another quantity, None for unknown."""
    name = sheet.names[column]
    unit = _written_unit(sheet, column)
    role_by_unit = _ROLE_BY_DIMENSION.get(si_unit(unit)[0]) if unit else None
    return role_by_unit or exact_role(name) or role_by_words(name)


def _written_unit(sheet: Sheet, column: int) -> str | None:
    """Return the unit of a column by its name, or the row of units; None without one."""
    return unit_of(sheet.names[column], sheet.layout.units[column] if column < len(sheet.layout.units) else "")


def records_by_column(sheet: Sheet) -> list[TableRecord]:
    """Return the records that columns name by a text or a whole number in each row.

    `sheet` is the text table; a record is the rows with the same texts in these columns. Of several such columns those
    count which divide the rows further, as a site does those of a specimen.
    """
    columns = [
        column
        for column, name in enumerate(sheet.names)
        if NAMING & {*words_of(name)}
        and column_role(sheet, column) in (None, "other")
        and _written_unit(sheet, column) is None
    ]
    if not columns:
        return []
    # Columns are taken in their order, each if it divides the rows into more records.
    counts = _row_counts(sheet, columns)
    naming_indices: tuple[int, ...] = ()
    for index in range(len(columns)):
        finer_indices = (*naming_indices, index)
        finer_counts = _merged_counts(counts, finer_indices)
        divides_further = len(finer_counts) > len(_merged_counts(counts, naming_indices))
        if divides_further and _are_names_of_records(finer_counts, sheet):
            naming_indices = finer_indices
    record_counts = _merged_counts(counts, naming_indices)
    if not naming_indices or len(record_counts) < 2:
        return []
    naming = tuple(columns[index] for index in naming_indices)
    return [
        TableRecord(printable(" ".join(texts))[:MAX_RECORD_NAME], naming=naming, texts=texts) for texts in record_counts
    ]


def _row_counts(sheet: Sheet, columns: Sequence[int]) -> Counter[tuple[str, ...]]:
    """Return the number of rows by their texts in some columns; an empty cell stands for the one above it."""
    current_texts = [""] * len(columns)
    counts = Counter[tuple[str, ...]]()
    with open_text(sheet.path, *sheet.text_keys) as file:
        lines = islice(bounded_lines(file, sheet.path), sheet.layout.begin, None)
        for cells in sheet.dialect.rows(line for line in lines if not sheet.dialect.is_comment(line)):
            if sum(map(sheet.dialect.is_value, cells)) < 2:
                continue  # a footer is not a row of a record
            for index, column in enumerate(columns):
                text = cells[column].strip() if column < len(cells) else ""
                current_texts[index] = text or current_texts[index]
            counts[tuple(current_texts)] += 1
    return counts


def _merged_counts(counts: Mapping[tuple[str, ...], int], indices: Sequence[int]) -> Counter[tuple[str, ...]]:
    """Return the number of rows by the texts at some indices alone."""
    merged_counts = Counter[tuple[str, ...]]()
    for texts, count in counts.items():
        merged_counts[tuple(texts[index] for index in indices)] += count
    return merged_counts


def _are_names_of_records(counts: Mapping[tuple[str, ...], int], sheet: Sheet) -> bool:
    """Return True if texts name records: no fractions, none of them empty, and most of them those of many rows."""
    usual_count = sorted(counts.values())[len(counts) // 2]
    texts = {text for key in counts for text in key}
    numbers = [number(text, sheet.dialect.decimal) for text in texts if sheet.dialect.is_number(text)]
    are_whole = all(value % 1.0 == 0.0 for value in numbers)
    return usual_count >= _MIN_USUAL_ROWS and are_whole and ("",) not in counts
