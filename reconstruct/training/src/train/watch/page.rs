//! Page of a training: its curves, its latest novel view and its latest numbers, as one HTML file without scripts
//! of others.
//!
//! It is opened from disk. While the training learns, a browser loads it anew every few seconds, unless its box says
//! no.

use std::{io, path::PathBuf};

use omnilife_charts::{ChartError, NARROW_SIZE, SIZE, Series, Titles, log_log, over_log_x};
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
                RELOAD.replace("@SECONDS@", &RELOAD_SECONDS.to_string()),
                format!("Learning: iteration {done} of {iterations}."),
            ),
            PageState::Stopped => (
                String::new(),
                format!("Stopped after iteration {done} or later, before its end."),
            ),
            PageState::Ended => (String::new(), format!("Ended after iteration {done}.")),
        };
        let mut now = String::new();
        if let Some(image) = image {
            let image = for_html(image);
            now += &format!(
                "<figure><img src=\"{image}\" alt=\"The latest novel view\">\
                 <figcaption>The latest novel view</figcaption></figure>\n"
            );
        }
        now += &numbers(trace.last());
        let mut curves = String::new();
        let quality = series(trace, &DECIBELS, |_| true);
        if !quality.is_empty() {
            let titles = Titles {
                x: "wall-clock time (s)",
                y: "PSNR (dB)",
            };
            curves += &in_two_sizes(|size| over_log_x(size, "Quality", &titles, &quality))?;
        }
        let loss = series(trace, &LOSS, |value| value > 0.0);
        if !loss.is_empty() {
            let titles = Titles {
                x: "wall-clock time (s)",
                y: "loss",
            };
            curves += &in_two_sizes(|size| log_log(size, "Loss", &titles, &loss))?;
        }
        Ok(TEMPLATE
            .replace("@RELOAD@", &reload)
            .replace("@WORDS@", &words)
            .replace("@NOW@", &now)
            .replace("@CURVES@", &curves)
            // Last: it comes from files of others.
            .replace("@TITLE@", &for_html(&self.title)))
    }
}

/// Returns a chart as wide screens show it, and as phones do.
fn in_two_sizes(
    draw: impl Fn((u32, u32)) -> Result<String, ChartError>,
) -> Result<String, ChartError> {
    let (wide, narrow) = (draw(SIZE)?, draw(NARROW_SIZE)?);
    Ok(format!(
        "<div class=\"wide\">{wide}</div>\n<div class=\"narrow\">{narrow}</div>\n"
    ))
}

/// Reloads the page while its box is ticked.
const RELOAD: &str = r##"<p><label><input type="checkbox" id="reload"> Reload every @SECONDS@ s</label></p>
<script>
const box = document.getElementById("reload");
box.checked = location.hash !== "#still";
box.addEventListener("change", () => { location.hash = box.checked ? "" : "still"; });
setInterval(() => { if (box.checked) location.reload(); }, 1000 * @SECONDS@);
</script>"##;

const TEMPLATE: &str = r##"<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<link rel="icon" href="data:,">
<title>@TITLE@</title>
<style>
:root { --paper: #fff; --ink: #16191d; --soft: #4b5563; --rule: #d3d7dd; }
@media (prefers-color-scheme: dark) { :root { --paper: #14171a; --ink: #eceff2; --soft: #b4bcc6; --rule: #3a4149; } }
body { margin: 0; background: var(--paper); color: var(--ink); font: 1rem/1.5 system-ui, sans-serif; }
main { max-width: 86rem; margin: 0 auto; padding: 0.5rem 1.25rem 2rem; }
h1 { font-size: 1.6rem; line-height: 1.2; margin: 1rem 0 0.5rem; overflow-wrap: anywhere; }
.all { display: grid; gap: 1.25rem 2rem; align-items: start; }
/* Charts have their own size beside the rest: their texts are small. */
@media (min-width: 76rem) { .all { grid-template-columns: minmax(0, 1fr) 760px; } }
figure { margin: 0 0 1rem; }
figcaption { color: var(--soft); font-size: 0.875rem; }
img, svg { display: block; max-width: 100%; height: auto; }
.narrow { display: none; }
/* Charts are black on white as files. */
svg text { fill: var(--ink); }
svg [stroke="#000000"] { stroke: var(--ink); }
svg [fill="#FFFFFF"] { fill: var(--paper); }
svg [stroke="#3C3C3C"] { stroke: var(--soft); }
table { border-collapse: collapse; font-size: 0.925rem; width: 100%; max-width: 26rem; }
th, td { padding: 0.2rem 0; border-bottom: 1px solid var(--rule); }
th { font-weight: normal; text-align: left; padding-right: 1.5rem; }
td { text-align: right; font-variant-numeric: tabular-nums; }
@media (max-width: 40rem) {
  main { padding: 0.25rem 0.9rem 1.5rem; }
  .wide { display: none; }
  .narrow { display: block; }
}
</style>
</head>
<body>
<main>
<h1>@TITLE@</h1>
<p>@WORDS@</p>
@RELOAD@
<div class="all">
<div>
@NOW@
</div>
<div>
@CURVES@
</div>
</div>
</main>
</body>
</html>
"##;

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
        let (name, value) = in_words(column, value);
        text += &format!("<tr><th>{name}</th><td>{value}</td></tr>\n");
    }
    text + "</table>"
}

/// Returns the name of a column without its unit, and a value with it.
fn in_words(column: &str, value: f64) -> (String, String) {
    let (name, value) = if let Some(name) = column.strip_suffix("_bytes") {
        (name.to_owned(), format!("{:.1} MB", value / 1e6))
    } else if let Some(name) = column.strip_suffix("_seconds") {
        (format!("{name} time"), format!("{value:.1} s"))
    } else if let Some(name) = column.strip_suffix("_db") {
        (name.to_owned(), format!("{value:.2} dB"))
    } else if value.fract() == 0.0 {
        (column.to_owned(), format!("{value}"))
    } else {
        (column.to_owned(), format!("{value:.4}"))
    };
    let name = name.replace('_', " ").replace("psnr", "PSNR");
    (name.replace("cpu", "CPU").replace("table", "model"), value)
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
        assert_eq!(
            text.matches("<svg").count(),
            4,
            "two charts in two sizes: {text}"
        );
        assert!(text.contains("src=\"trace/000100/000004.png\""), "{text}");
        assert!(text.contains("location.reload()"), "{text}");
        assert!(text.contains("<td>100</td>"), "{text}");
        assert!(text.contains("<th>wall time</th><td>9.0 s</td>"), "{text}");
        let title = "odgs on &lt;script&gt; &amp; &quot;more&quot;";
        assert_eq!(text.matches(title).count(), 2, "{text}");
        for (state, words) in [
            (PageState::Stopped, "Stopped after iteration 100 or later"),
            (PageState::Ended, "Ended after iteration 100."),
        ] {
            page.write(&trace, state, None).expect("written");
            let text = written(&page);
            assert!(text.contains(words) && !text.contains("reload"), "{text}");
        }
    }
}
