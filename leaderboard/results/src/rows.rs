//! Rows of the tables: one value each, with the data of all columns.

use omnilife_schemas::{
    frame_scores::{FRAME_SCORES_FILE, FrameScores},
    layout::{CURVE_FILE, RESULT_FILE},
    records::{ObjectResult, ResultRecord, Summary},
};

use crate::{curve::CurvePoint, error::ResultsError, source::Source};

/// Name of novel views in tables.
const NOVEL: &str = "novel";

#[derive(Debug, Clone, Copy)]
pub(crate) struct Row<'a> {
    pub(crate) source: &'a Source<'a>,
    /// `input` or `novel`.
    pub(crate) view: &'a str,
    /// Id of the metric without its region.
    pub(crate) metric: &'a str,
    /// `whole`, `static` or `dynamic`.
    pub(crate) region: &'static str,
    /// The object that it is of, where it is of one.
    pub(crate) object: Option<&'a ObjectResult>,
    pub(crate) value: f64,
    /// Views over which the value is taken.
    pub(crate) of: ValueOf,
}

impl Row<'_> {
    /// Returns true if other methods on the scene have scores of the same region.
    pub(crate) fn compares(&self) -> bool {
        self.region == WHOLE || !self.source.has_other_regions
    }
}

/// The region of scores over all pixels.
const WHOLE: &str = "whole";

/// Views of a value: all views of a kind, one view, or one row of a trace.
#[derive(Debug, Clone, Copy)]
pub(crate) enum ValueOf {
    Views(Summary),
    View(View),
    Point(CurvePoint),
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    pub(crate) frame: u32,
    pub(crate) time_seconds: f64,
    /// 1 to 3: its third of the time from the first view to the last one.
    pub(crate) third: Option<i64>,
    /// World units from its camera to the nearest camera of an input view.
    pub(crate) distance_to_given: Option<f64>,
}

/// A result with the files beside it that a table reads.
#[derive(Debug)]
pub(crate) struct Loaded<'a> {
    source: &'a Source<'a>,
    views: Option<FrameScores>,
    curve: Vec<CurvePoint>,
}

/// Files that a table reads beside a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SideFile {
    Nothing,
    Views,
    Curve,
}

impl SideFile {
    /// Returns the usual name of the file.
    pub(crate) fn file(self) -> &'static str {
        match self {
            Self::Nothing => RESULT_FILE,
            Self::Views => FRAME_SCORES_FILE,
            Self::Curve => CURVE_FILE,
        }
    }
}

impl<'a> Loaded<'a> {
    pub(crate) fn read(source: &'a Source<'a>, beside: SideFile) -> Result<Self, ResultsError> {
        Ok(Self {
            source,
            views: match beside {
                SideFile::Views => source.views()?,
                SideFile::Nothing | SideFile::Curve => None,
            },
            curve: match beside {
                SideFile::Curve => source.curve()?,
                SideFile::Nothing | SideFile::Views => Vec::new(),
            },
        })
    }

    /// Returns true if the file that a table reads lies beside the result; a failed run needs none.
    pub(crate) fn has(&self, beside: SideFile) -> bool {
        if self.source.result.run_failure.is_some() {
            return true;
        }
        match beside {
            SideFile::Nothing => true,
            SideFile::Views => self.views.is_some(),
            SideFile::Curve => !self.curve.is_empty(),
        }
    }

    /// Calls `each` with every row of a table of means.
    pub(crate) fn means(&'a self, each: &mut dyn FnMut(Row<'a>)) {
        for (view, metric, summary) in means(self.source.result) {
            let (metric, region) = split_region(metric);
            each(Row {
                source: self.source,
                view,
                metric,
                region,
                object: None,
                value: summary.mean,
                of: ValueOf::Views(*summary),
            });
        }
    }

    /// Calls `each` with the mean of every object by every metric.
    pub(crate) fn objects(&'a self, each: &mut dyn FnMut(Row<'a>)) {
        let result = self.source.result;
        let shown = result
            .objects
            .iter()
            .filter(|_| result.run_failure.is_none());
        for object in shown.flat_map(|objects| &objects.objects) {
            for (metric, summary) in &object.scores {
                each(Row {
                    source: self.source,
                    view: &object.view,
                    metric,
                    region: WHOLE,
                    object: Some(object),
                    value: summary.mean,
                    of: ValueOf::Views(*summary),
                });
            }
        }
    }

    /// Calls `each` with the score of every view by every metric.
    pub(crate) fn views(&'a self, each: &mut dyn FnMut(Row<'a>)) {
        let Some(table) = &self.views else {
            return;
        };
        let thirds = Thirds::of(table);
        for row in &table.rows {
            let view = View {
                frame: row.frame,
                time_seconds: row.time_seconds,
                third: thirds.of_time(row.time_seconds),
                distance_to_given: row.distance_to_given,
            };
            for (metric, score) in table.metrics.iter().zip(&row.scores) {
                let Some(value) = *score else { continue };
                let (metric, region) = split_region(metric);
                each(Row {
                    source: self.source,
                    view: &row.view,
                    metric,
                    region,
                    object: None,
                    value,
                    of: ValueOf::View(view),
                });
            }
        }
    }

    /// Calls `each` with every score along the training.
    pub(crate) fn curve(&'a self, each: &mut dyn FnMut(Row<'a>)) {
        for point in &self.curve {
            for (metric, region, value) in point.scores() {
                each(Row {
                    source: self.source,
                    view: NOVEL,
                    metric,
                    region,
                    object: None,
                    value,
                    of: ValueOf::Point(*point),
                });
            }
        }
    }
}

/// Returns kind of view, metric and mean of all scores of a result. A failed run has none.
fn means(result: &ResultRecord) -> impl Iterator<Item = (&str, &str, &Summary)> {
    let kinds = [
        ("input", &result.input_views),
        ("novel", &result.novel_views),
    ];
    let shown = kinds.into_iter().filter(|_| result.run_failure.is_none());
    shown.flat_map(|(view, scores)| {
        scores
            .iter()
            .map(move |(metric, summary)| (view, metric.as_str(), summary))
    })
}

/// Splits `psnr-static` into `psnr` and `static`.
fn split_region(metric: &str) -> (&str, &'static str) {
    for (ending, region) in [("-static", "static"), ("-dynamic", "dynamic")] {
        if let Some(metric) = metric.strip_suffix(ending) {
            return (metric, region);
        }
    }
    (metric, WHOLE)
}

/// The time covered by the views of a result, seconds.
struct Thirds {
    first: f64,
    last: f64,
}

impl Thirds {
    /// Divides the time of the novel views, which all methods have: not all have input views.
    fn of(table: &FrameScores) -> Self {
        let is_novel = |view: &str| view == NOVEL;
        let has_novel = table.rows.iter().any(|row| is_novel(&row.view));
        let rows = table.rows.iter();
        let times = || {
            rows.clone()
                .filter(|row| !has_novel || is_novel(&row.view))
                .map(|row| row.time_seconds)
        };
        Self {
            first: times().fold(f64::INFINITY, f64::min),
            last: times().fold(f64::NEG_INFINITY, f64::max),
        }
    }

    /// Returns 1, 2 or 3; `None` if all views are simultaneous.
    fn of_time(&self, time: f64) -> Option<i64> {
        let span = self.last - self.first;
        (span > 0.0).then(|| ((3.0 * (time - self.first) / span) as i64).clamp(0, 2) + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_are_no_part_of_a_metric() {
        assert_eq!(split_region("psnr"), ("psnr", "whole"));
        assert_eq!(split_region("lpips-vgg-static"), ("lpips-vgg", "static"));
        assert_eq!(split_region("ssim-dynamic"), ("ssim", "dynamic"));
    }

    #[test]
    fn thirds_divide_the_time_of_novel_views() {
        let thirds = Thirds {
            first: 2.0,
            last: 5.0,
        };
        // Input views may lie before the first novel view and after the last one.
        let of = [0.5, 2.0, 2.9, 3.0, 4.1, 5.0, 6.5].map(|time| thirds.of_time(time));
        assert_eq!(of, [1, 1, 1, 2, 3, 3, 3].map(Some));
        let still = Thirds {
            first: 2.0,
            last: 2.0,
        };
        assert_eq!(still.of_time(2.0), None);
    }
}
