//! Error against run time: a curve for every method, a point if its training left none, or a level if it does not
//! train.

use maud::{Markup, html};

use omnilife_charts::Titles;
use omnilife_results::CurvePoint;
use omnilife_schemas::records::{Direction, ResultRecord};

use super::{
    SiteRequest, chart,
    chart::{Mark, Series},
    mean_curve,
};
use crate::{
    class::MethodClass, error::LeaderboardError, format, group::Group, layouts::standings,
    quantity::ViewKind,
};

/// The metric of the charts.
const ERROR_METRIC: &str = "psnr";

/// Maximum number of methods in a chart; the others are only in the table.
const MOST_SERIES: usize = 40;

/// Means over scenes of every complete method.
pub(super) fn of_group(
    request: &SiteRequest<'_>,
    group: &Group<'_>,
) -> Result<Markup, LeaderboardError> {
    let Some(index) = group.quantity(ViewKind::Novel, ERROR_METRIC) else {
        return Ok(html! {});
    };
    let mut series = Vec::new();
    let mut without = Vec::new();
    for method in standings(group) {
        let score = method.numbers.scores[index].filter(|_| method.complete);
        let Some(score) = score.filter(|_| series.len() < MOST_SERIES) else {
            without.push(method.method);
            continue;
        };
        let results: Vec<&ResultRecord> = (group.rows_of(method.method))
            .flat_map(|row| row.results.iter().copied())
            .collect();
        let seconds = method.numbers.training_seconds;
        match of_method(
            request,
            method.method,
            &results,
            method.class,
            (score, seconds),
        ) {
            Some(found) => series.push((method.class, found)),
            None => without.push(method.method),
        }
    }
    let direction = group.quantities[index].1;
    let left_out = html! {
        @if !without.is_empty() {
            " Not shown, for want of a complete score or a training time: "
            (shortened_list(&without)) "."
        }
    };
    let title = format!("Error against run time, protocol {}", group.protocol);
    Ok(html! {
        h3 { "Error against run time" }
        (drawn(&title, series, direction, &left_out)?)
    })
}

/// Draws one scene, or one method on its scenes: a series for each of the given results.
pub(super) fn of_results(
    request: &SiteRequest<'_>,
    title: &str,
    results: &[(&str, MethodClass, &ResultRecord)],
) -> Result<Markup, LeaderboardError> {
    let mut direction = Direction::HigherIsBetter;
    let mut series = Vec::new();
    let complete = results.iter().filter(|(_, _, result)| result.is_complete());
    for &(label, class, result) in complete.take(MOST_SERIES) {
        let Some(summary) = result.novel_views.get(ERROR_METRIC) else {
            continue;
        };
        direction = summary.direction.unwrap_or(direction);
        let numbers = (summary.mean, result.training_seconds);
        let found = of_method(request, label, &[result], class, numbers);
        series.extend(found.map(|found| (class, found)));
    }
    drawn(title, series, direction, &html! {})
}

fn of_method(
    request: &SiteRequest<'_>,
    label: &str,
    results: &[&ResultRecord],
    class: MethodClass,
    (score, seconds): (f64, Option<f64>),
) -> Option<Series> {
    // Scenes count alike, whatever the number of their seeds, as in tables.
    let seeds_of = |scene: &str| results.iter().filter(|other| other.scene == scene).count();
    let of_results: Vec<(f64, &[CurvePoint])> = (results.iter())
        .map(|result| (1.0 / seeds_of(&result.scene) as f64, request.curve(result)))
        .collect();
    let curve = mean_curve::mean(&of_results);
    let marks: Vec<Mark> = match seconds.filter(|&seconds| seconds > 0.0) {
        Some(seconds) if curve.len() < 2 => vec![Mark {
            x: seconds,
            y: score,
            description: format!("{label}: {score:.3} dB after {seconds:.1} s of training"),
        }],
        None if curve.len() < 2 => {
            return (class == MethodClass::WithoutTraining).then(|| Series {
                label: label.to_owned(),
                marks: Vec::new(),
                level: Some((score, format!("{label}: {score:.3} dB without training"))),
                on_front: false,
            });
        }
        _ => (curve.iter())
            .map(|point| Mark {
                x: point.seconds,
                y: point.psnr_db,
                description: format!(
                    "{label}: {:.3} dB after {:.1} s, {}",
                    point.psnr_db,
                    point.seconds,
                    format::counted(point.iteration as usize, "iteration")
                ),
            })
            .collect(),
    };
    Some(Series {
        label: label.to_owned(),
        marks,
        level: None,
        on_front: false,
    })
}

fn drawn(
    title: &str,
    mut series: Vec<(MethodClass, Series)>,
    direction: Direction,
    left_out: &Markup,
) -> Result<Markup, LeaderboardError> {
    let any_trained = series.iter().any(|(_, series)| !series.marks.is_empty());
    if !any_trained {
        return Ok(html! {
            p { "No method has both scores of all scenes and a training time." (left_out) }
        });
    }
    mark_front(&mut series, direction);
    let series: Vec<Series> = series.into_iter().map(|(_, series)| series).collect();
    let drawing = chart::run_time(
        title,
        &Titles {
            x: "Training time per scene (s), logarithmic",
            y: "PSNR of novel views (dB)",
        },
        &series,
    )?;
    let has = |of: &dyn Fn(&Series) -> bool| series.iter().any(of);
    Ok(html! {
        figure {
            (drawing)
            figcaption {
                "Higher is better, further left is sooner. "
                @if has(&|series| series.marks.len() > 1) {
                    "Curves: novel views along the training, means over the scenes at equal iterations. "
                }
                @if has(&|series| series.marks.len() == 1) {
                    "Single points: at the end of the training. "
                }
                @if has(&|series| series.level.is_some()) {
                    "Dashed levels: methods that learn nothing of a scene. "
                }
                "Ringed: no other method of its class ends both sooner and better. Times are of the machine that \
                 each method was trained on."
                (left_out)
            }
        }
    })
}

/// Returns the first names of a list and how many more there are.
fn shortened_list(names: &[&str]) -> String {
    const SHOWN: usize = 12;
    let mut text = names[..names.len().min(SHOWN)].join(", ");
    if names.len() > SHOWN {
        text.push_str(&format!(" and {} more", names.len() - SHOWN));
    }
    text
}

/// Marks the front: a method is on it when no other of its class ends at least as soon and at least as well, and better
/// in one.
fn mark_front(series: &mut [(MethodClass, Series)], direction: Direction) {
    let ends: Vec<(MethodClass, f64, f64)> = (series.iter())
        .filter_map(|(class, series)| Some((*class, series.marks.last()?)))
        .map(|(class, mark)| (class, mark.x, mark.y))
        .collect();
    for (class, series) in series {
        let Some((x, y)) = series.marks.last().map(|mark| (mark.x, mark.y)) else {
            continue;
        };
        let beats = |&(other, other_x, other_y): &(MethodClass, f64, f64)| {
            let no_worse = other_x <= x && !direction.prefers(y, other_y);
            other == *class && no_worse && (other_x < x || direction.prefers(other_y, y))
        };
        series.on_front = !ends.iter().any(beats);
    }
}
