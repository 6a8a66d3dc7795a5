//! Page of a training: its curves, its latest novel view and its latest numbers, as one HTML file without scripts
//! of others.
//!
//! It is opened from disk. While the training learns, a browser loads it anew every few seconds.

use std::{io, path::PathBuf};

use omnilife_charts::{ChartError, Series, Titles, log_log, over_log_x};
use omnilife_schemas::{
    plain_text::for_html,
    store::{self, StoreError},
};

use crate::train::trace::TracePoint;

/// Seconds until a browser loads the page of a training that learns anew.
const RELOAD_SECONDS: u32 = 5;
/// Columns of the trace that are drawn in decibels, with their names in the legend.
const DECIBELS: [(&str, &str); 4] = [
    ("train_psnr_db", "training steps"),
    ("input_psnr_db", "input views"),
    ("input_psnr_static_db", "input views, static region"),
    ("input_psnr_dynamic_db", "input views, dynamic region"),
];
const LOSS: [(&str, &str); 1] = [("train_loss", "training loss")];

/// Place and title of a page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Page {
    /// The file.
    pub file: PathBuf,
    /// Title, such as the method and the scene.
    pub title: String,
}

/// State of the training that a page shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PageState {
    /// It learns.
    Learning {
        /// Iterations of the whole run.
        iterations: u64,
    },
    /// It failed or was interrupted.
    Stopped,
    /// It has ended.
    Ended,
}

impl Page {
    /// Writes the page, whole or not at all; `image` is relative to its folder.
    ///
    /// # Errors
    /// When a curve cannot be drawn, or the file cannot be written.
    pub fn write(
        &self,
        trace: &[TracePoint],
        state: PageState,
        image: Option<&str>,
    ) -> Result<(), StoreError> {
        let failed = |error: ChartError| StoreError::write(&self.file, io::Error::other(error));
        let text = self.text(trace, state, image).map_err(failed)?;
        store::write_bytes(&self.file, text.as_bytes())
    }

    fn text(
        &self,
        trace: &[TracePoint],
        state: PageState,
        image: Option<&str>,
    ) -> Result<String, ChartError> {
        let done = trace.last().map_or(0, |row| row.iteration);
        let (reload, words) = match state {
            PageState::Learning { iterations } => (
                format!("<meta http-equiv=\"refresh\" content=\"{RELOAD_SECONDS}\">"),
                format!("Learning: iteration {done} of {iterations}."),
            ),
            PageState::Stopped => (
                String::new(),
                format!("Stopped after iteration {done} or later, before its end."),
            ),
            PageState::Ended => (String::new(), format!("Ended after iteration {done}.")),
        };
        let mut body = String::new();
        if let Some(image) = image {
            let image = for_html(image);
            body += &format!("<p><img src=\"{image}\" alt=\"the latest novel view\"></p>\n");
        }
        let quality = series(trace, &DECIBELS, |_| true);
        if !quality.is_empty() {
            let titles = Titles {
                x: "wall-clock time (s)",
                y: "PSNR (dB)",
            };
            body += &over_log_x("Quality", &titles, &quality)?;
        }
        let loss = series(trace, &LOSS, |value| value > 0.0);
        if !loss.is_empty() {
            let titles = Titles {
                x: "wall-clock time (s)",
                y: "loss",
            };
            body += &log_log("Loss", &titles, &loss)?;
        }
        Ok(TEMPLATE
            .replace("@RELOAD@", &reload)
            .replace("@WORDS@", &words)
            .replace("@NUMBERS@", &numbers(trace.last()))
            .replace("@BODY@", &body)
            // Last: it comes from files of others.
            .replace("@TITLE@", &for_html(&self.title)))
    }
}

const TEMPLATE: &str = r#"<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
@RELOAD@
<title>@TITLE@</title>
<style>
body { font-family: sans-serif; margin: 1.5em; }
img { max-width: min(100%, 1024px); }
svg { max-width: 100%; height: auto; }
th { font-weight: normal; text-align: left; padding-right: 1.5em; }
td { text-align: right; font-variant-numeric: tabular-nums; }
</style>
</head>
<body>
<h1>@TITLE@</h1>
<p>@WORDS@</p>
@BODY@
@NUMBERS@
</body>
</html>
"#;

/// Returns the columns of a trace over time as far as they have values that `is_drawn` accepts.
fn series(
    trace: &[TracePoint],
    columns: &[(&str, &str)],
    is_drawn: impl Fn(f64) -> bool,
) -> Vec<Series> {
    let mut all = Vec::new();
    for (column, name) in columns {
        let mut points = Vec::new();
        for row in trace.iter().filter(|row| row.wall_seconds > 0.0) {
            let mut known = row.known();
            if let Some((_, value)) = known.find(|(other, _)| other == column)
                && value.is_finite()
                && is_drawn(value)
            {
                points.push((row.wall_seconds, value));
            }
        }
        if !points.is_empty() {
            let name = (*name).to_owned();
            all.push(Series { name, points });
        }
    }
    all
}

/// Returns the numbers of a row as a table.
fn numbers(row: Option<&TracePoint>) -> String {
    let Some(row) = row else {
        return String::new();
    };
    let mut text = "<table>\n".to_owned();
    for (column, value) in row.known() {
        let name = column.replace('_', " ");
        let value = if value.fract() == 0.0 {
            format!("{value}")
        } else {
            format!("{value:.4}")
        };
        text += &format!("<tr><th>{name}</th><td>{value}</td></tr>\n");
    }
    text + "</table>"
}

#[cfg(test)]
mod tests {
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::{learner::ModelSize, train::checkpoint::LoopState};
    use omnilife_engine::step::StepStatistics;

    fn row(iteration: u64, seconds: f64, db: Option<f64>) -> TracePoint {
        let mut state = LoopState::new(Pcg64Mcg::new(1));
        state.iteration = iteration;
        let size = ModelSize::default();
        TracePoint {
            wall_seconds: seconds,
            train_psnr_db: db,
            train_loss: db.map(|_| 0.25),
            ..TracePoint::new(&state, &StepStatistics::default(), size, &[])
        }
    }

    fn page() -> (tempfile::TempDir, Page) {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("progress.html");
        let title = "odgs on <script> & \"more\"".to_owned();
        (folder, Page { file, title })
    }

    fn written(page: &Page) -> String {
        std::fs::read_to_string(&page.file).expect("read")
    }

    #[test]
    fn a_page_shows_the_trace_so_far() {
        let (_folder, page) = page();
        let learning = PageState::Learning { iterations: 300 };
        // Before the first step there is no curve.
        let mut trace = vec![row(0, 0.0, None)];
        page.write(&trace, learning, None).expect("written");
        let text = written(&page);
        assert!(!text.contains("<svg") && !text.contains("<img"), "{text}");
        assert!(text.contains("Learning: iteration 0 of 300."), "{text}");
        trace.extend([row(10, 1.5, Some(20.5)), row(100, 9.0, Some(f64::NAN))]);
        page.write(&trace, learning, Some("trace/000100/000004.png"))
            .expect("written");
        let text = written(&page);
        assert_eq!(text.matches("<svg").count(), 2, "{text}");
        assert!(text.contains("src=\"trace/000100/000004.png\""), "{text}");
        assert!(text.contains("http-equiv=\"refresh\""), "{text}");
        assert!(text.contains("<td>100</td>"), "{text}");
        let title = "odgs on &lt;script&gt; &amp; &quot;more&quot;";
        assert_eq!(text.matches(title).count(), 2, "{text}");
        for (state, words) in [
            (PageState::Stopped, "Stopped after iteration 100 or later"),
            (PageState::Ended, "Ended after iteration 100."),
        ] {
            page.write(&trace, state, None).expect("written");
            let text = written(&page);
            assert!(text.contains(words) && !text.contains("refresh"), "{text}");
        }
    }
}
