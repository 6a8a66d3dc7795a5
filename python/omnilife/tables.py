"""Tables as dictionaries of columns, in a wide and a long form, and as data frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Optional

from . import _html
from ._extras import extra
from .errors import InputError
from .metrics import METRICS

if TYPE_CHECKING:
    import pandas
    import polars

#: Columns of a long table that describe one metric.
SUMMARY = ("mean", "standard_deviation", "views", "undefined_views", "direction")


class Table(dict[str, list[Any]]):
    """Columns by name, lists of equal length with None for what is not known.

    `pandas.DataFrame` and `polars.DataFrame` take it, as they take every dictionary of columns.
    """

    def wide(self, value: Optional[str] = None) -> Table:
        """Returns one row per result and view with a column per metric, which holds its `value`.

        `value` is a column, by default `mean` or else `value`; other columns on single metrics, such as
        `standard_deviation`, are left out. A table without a column `metric` is wide and returned as it is.
        """
        if "metric" not in self:
            return Table(self)
        if value is None:
            value = "mean" if "mean" in self else "value"
        if value not in self:
            raise InputError(f"the table has no column {value}, only {', '.join(self)}")
        keys = [name for name in self if name not in ("metric", "value", value, *SUMMARY)]
        metrics = list(dict.fromkeys(self["metric"]))
        rows: dict[tuple[Any, ...], dict[str, Any]] = {}
        for at, (metric, score) in enumerate(zip(self["metric"], self[value])):
            key = tuple(self[name][at] for name in keys)
            scores = rows.setdefault(key, {})
            if metric in scores:
                raise InputError(
                    f"the table has two rows of {metric} that differ in no other column"
                )
            scores[metric] = score
        table = Table({name: [key[at] for key in rows] for at, name in enumerate(keys)})
        table.update({name: [scores.get(name) for scores in rows.values()] for name in metrics})
        return table

    def long(self, metrics: Optional[Sequence[str]] = None) -> Table:
        """Returns one row per row and metric, with the columns `metric` and `value`.

        `metrics` are columns; without it, those named by the id of a metric. Columns such as `psnr_sd` become
        `standard_deviation`. A table with a column `metric` is long and returned as it is.
        """
        if "metric" in self:
            return Table(self)
        chosen = [name for name in self if name in METRICS] if metrics is None else list(metrics)
        unknown = [name for name in chosen if name not in self]
        if unknown or not chosen:
            said = f"no column {unknown[0]}" if unknown else "no column of a metric"
            raise InputError(f"the table has {said}, only {', '.join(self)}")
        deviations = {name: f"{name}_sd" for name in chosen if f"{name}_sd" in self}
        keys = [name for name in self if name not in (*chosen, *deviations.values())]
        count = len(self[chosen[0]])
        table = Table({name: [value for value in self[name] for _ in chosen] for name in keys})
        table["metric"] = chosen * count
        table["value"] = [self[name][at] for at in range(count) for name in chosen]
        if deviations:
            table["standard_deviation"] = [
                self[deviations[name]][at] if name in deviations else None
                for at in range(count)
                for name in chosen
            ]
        return table

    def to_polars(self) -> polars.DataFrame:
        """Returns a data frame of Polars, which is the extra `polars`."""
        columns = {name: _of_one_type(column) for name, column in self.items()}
        frame: polars.DataFrame = extra("polars", "polars").DataFrame(columns)
        return frame

    def to_pandas(self) -> pandas.DataFrame:
        """Returns a data frame of pandas, which is the extra `pandas`.

        Whole numbers of which some are not known stay whole: their column is of the type Int64.
        """
        module = extra("pandas", "pandas")
        columns: dict[str, Any] = {}
        for name, values in self.items():
            column = _of_one_type(values)
            kinds = {type(value) for value in column}
            is_whole = kinds == {int, type(None)}
            columns[name] = module.array(column, dtype="Int64") if is_whole else column
        frame: pandas.DataFrame = module.DataFrame(columns)
        return frame

    def _repr_html_(self) -> str:
        return _html.table(self)


def _of_one_type(column: list[Any]) -> list[Any]:
    """The column, of floats where some of its numbers are whole and others are not."""
    kinds = {type(value) for value in column}
    if not {int, float} <= kinds:
        return column
    return [float(value) if isinstance(value, int) else value for value in column]
