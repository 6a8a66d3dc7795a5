//! Stiff and extreme cases of tracks, for the catalogue of `bench stability`: rays and the ground, chains,
//! and paths.

use glam::{DMat3, DVec2, DVec3, dvec2, dvec3};
use omnilife_schemas::{
    band_matrix::BandMatrix,
    camera::PinholeCamera,
    ground_plane::Plane,
    posed_view::PosedView,
    records::{StabilityMeasures, StabilityRow, StabilityStatus},
    statistics::largest_or_nan,
};

use super::{
    association::{Sighting, associate},
    spline_fit::{Observation, fit, fit_with},
};

/// A case: its id, its description, its remedy, and its check.
type Case = (&'static str, &'static str, &'static str, fn() -> Checked);

/// Outcome of a case.
struct Checked {
    /// Reason of a failure.
    fault: Option<String>,
    /// The largest error and its limit, for cases that have one.
    error: Option<[f64; 2]>,
}

impl Checked {
    /// Returns the outcome of a case without an error.
    fn by(fault: Option<String>) -> Self {
        Self { fault, error: None }
    }

    fn measures(&self) -> Option<StabilityMeasures> {
        let [error, limit] = self.error?;
        Some(StabilityMeasures {
            forward_error: error.is_finite().then_some(error),
            forward_share: Some(0.0),
            forward_limit: Some(limit),
            gradient_error: None,
            gradient_limit: None,
            is_finite: error.is_finite(),
            drawn: 0,
            gaussians: 0,
        })
    }
}

const CASES: &[Case] = &[
    (
        "trajectory-fit",
        "paths of 1, 2 and 3 detections, of fewer than knots, all at one time, twice at each, uneven, with a \
         gap longer than the path, of something that stands",
        "lower degrees, and a weak pull to an even path",
        trajectory_fit,
    ),
    (
        "trajectory-far",
        "a path 5e6 m from the origin, as UTM coordinates are",
        "rays and distances are relative to the camera",
        trajectory_far,
    ),
    (
        "trajectory-camera",
        "paths seen by cameras of focal lengths 1e-3 and 1e6 pixels, and with the principal point outside",
        "pixels are compared as angles",
        trajectory_camera,
    ),
    (
        "spline-condition",
        "normal equations with condition numbers of 1e3 to 1e12",
        "Cholesky in f64; what is not positive definite is refused",
        spline_condition,
    ),
    (
        "lift-ground",
        "rays along the ground, away from it, and from below it",
        "no distance",
        lift_ground,
    ),
    (
        "chains-crowd",
        "500 vehicles, all in one place, at one time, none, and places that are not finite",
        "an answer, whatever it is",
        chains_crowd,
    ),
];

/// Returns the rows of the catalogue, evaluated on the CPU.
pub fn rows() -> Vec<StabilityRow> {
    let row = |(id, title, action, judge): &Case| {
        let checked = judge();
        StabilityRow {
            case: (*id).to_owned(),
            title: (*title).to_owned(),
            parameterization: "none".to_owned(),
            backend: "cpu".to_owned(),
            measured: checked.measures(),
            action: (*action).to_owned(),
            status: if checked.fault.is_none() {
                StabilityStatus::Pass
            } else {
                StabilityStatus::Fail
            },
            reason: checked.fault.unwrap_or_default(),
        }
    };
    CASES.iter().map(row).collect()
}

/// Looks down from 50 m.
fn view(seconds: f64, centre: DVec3, camera: PinholeCamera) -> PosedView {
    PosedView {
        frame: 0,
        seconds,
        camera: camera.into(),
        to_world: DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z),
        centre: centre + dvec3(0.0, 0.0, 50.0),
    }
}

fn camera() -> PinholeCamera {
    PinholeCamera::with_horizontal_field_of_view(640, 360, 1.1)
}

/// Returns observations of an object that goes along x at `speed` below `origin`.
fn seen(times: &[f64], speed: f64, origin: DVec3, camera: PinholeCamera) -> Vec<PosedView> {
    let at = |&seconds: &f64| view(seconds, origin + DVec3::X * (speed * seconds), camera);
    times.iter().map(at).collect()
}

/// Returns the points straight below each view.
fn below(views: &[PosedView]) -> Vec<Observation<'_>> {
    let observe = |view| Observation {
        view,
        pixel: PosedView::pixel(view, view.centre - DVec3::Z * 50.0).unwrap_or(DVec2::ZERO),
        distance: 50.0,
        slack: 1.0,
    };
    views.iter().map(observe).collect()
}

/// Returns the error of a fitted path at its observations; the reason if there is no path.
fn error_of(views: &[PosedView], coefficients: Option<usize>) -> Result<f64, String> {
    let observations = below(views);
    let path = match coefficients {
        None => fit(&observations, 0.005),
        Some(count) => fit_with(&observations, 3, count, 0.005),
    };
    let path = path.ok_or("no path")?;
    if let Some(fault) = path.spline.fault() {
        return Err(format!("a path that {fault}"));
    }
    let error = |view: &PosedView| {
        let place = path.spline.position(view.seconds);
        place.distance(view.centre - DVec3::Z * 50.0)
    };
    Ok(views.iter().map(error).fold(0.0, largest_or_nan))
}

/// Returns the largest error, and the names of cases whose error is too large.
fn faults(cases: impl Iterator<Item = (String, Result<f64, String>)>, most: f64) -> Checked {
    let (mut bad, mut worst) = (Vec::new(), 0.0_f64);
    for (name, error) in cases {
        match error {
            Ok(error) if error <= most => worst = largest_or_nan(worst, error),
            Ok(error) => {
                worst = largest_or_nan(worst, error);
                bad.push(format!("{name}: {error:e} m off"));
            }
            Err(reason) => bad.push(format!("{name}: {reason}")),
        }
    }
    Checked {
        fault: (!bad.is_empty()).then(|| bad.join("; ")),
        error: Some([worst, most]),
    }
}

fn trajectory_fit() -> Checked {
    let cases: [(&str, Vec<f64>, f64, Option<usize>); 9] = [
        ("1", vec![2.0], 5.0, None),
        ("2", vec![2.0, 2.5], 5.0, None),
        ("3", vec![2.0, 2.5, 3.0], 5.0, None),
        (
            "fewer than knots",
            vec![0.0, 1.0, 2.0, 3.0, 4.0],
            5.0,
            Some(12),
        ),
        ("at one time", vec![2.0; 6], 5.0, None),
        (
            "twice",
            vec![0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0],
            5.0,
            None,
        ),
        ("uneven", vec![0.0, 0.01, 0.011, 2.0, 2.5, 9.0], 5.0, None),
        ("gap", vec![0.0, 0.5, 1.0, 101.0, 101.5, 102.0], 1.0, None),
        ("standing", (0..20).map(f64::from).collect(), 0.0, None),
    ];
    let judged = cases.into_iter().map(|(name, times, speed, count)| {
        let views = seen(&times, speed, DVec3::ZERO, camera());
        (name.to_owned(), error_of(&views, count))
    });
    faults(judged, 3e-9)
}

fn trajectory_far() -> Checked {
    let times: Vec<f64> = (0..20).map(|n| 0.5 * f64::from(n)).collect();
    let origin = dvec3(691_000.0, 5_335_000.0, 520.0);
    let views = seen(&times, 7.0, origin, camera());
    faults(
        [("far".to_owned(), error_of(&views, None))].into_iter(),
        9e-9,
    )
}

fn trajectory_camera() -> Checked {
    let times: Vec<f64> = (0..12).map(f64::from).collect();
    let with = |fx: f64, cx: f64| PinholeCamera {
        fx,
        fy: fx,
        cx,
        ..camera()
    };
    let cases = [
        ("focal length 1e-3", with(1e-3, 320.0)),
        ("focal length 1e6", with(1e6, 320.0)),
    ];
    let judged = cases.into_iter().map(|(name, camera)| {
        let views = seen(&times, 7.0, DVec3::ZERO, camera);
        (name.to_owned(), error_of(&views, None))
    });
    // The principal point is outside of the image, and so are points straight below.
    let views = seen(&times, 7.0, DVec3::ZERO, with(500.0, -900.0));
    let observations: Vec<Observation<'_>> = views
        .iter()
        .map(|view| Observation {
            view,
            pixel: dvec2(320.0, 180.0),
            distance: 50.0,
            slack: 1.0,
        })
        .collect();
    let outside = fit(&observations, 0.005).ok_or("no path".to_owned());
    let outside = outside.map(|path| {
        let error = |one: &Observation<'_>| {
            path.spline
                .position(one.view.seconds)
                .distance(one.position())
        };
        observations.iter().map(error).fold(0.0, largest_or_nan)
    });
    faults(
        judged.chain([("principal point outside".to_owned(), outside)]),
        2.5e-13,
    )
}

fn spline_condition() -> Checked {
    const LIMIT: f64 = 8e-15;
    let (mut bad, mut worst) = (Vec::new(), 0.0_f64);
    for exponent in [3, 6, 9, 12] {
        // A band with a known solution, scaled on both sides by powers that make it as ill-conditioned.
        let size = 24;
        let scale = |row: usize| 10.0_f64.powf(-0.5 * f64::from(exponent) * row as f64 / 23.0);
        let entry = |row: usize, column: usize| {
            let value = match row - column {
                0 => 2.0,
                1 => -0.9,
                _ => 0.0,
            };
            value * scale(row) * scale(column)
        };
        let mut matrix = BandMatrix::new(size, 1);
        let truth: Vec<f64> = (0..size)
            .map(|row| (row as f64).sin() / scale(row))
            .collect();
        let mut right = vec![0.0; size];
        for row in 0..size {
            for column in row.saturating_sub(1)..=row {
                matrix.add(row, column, entry(row, column));
                right[row] += entry(row, column) * truth[column];
                if column < row {
                    right[column] += entry(row, column) * truth[row];
                }
            }
        }
        let error = matrix.solve(&right).map_or(f64::INFINITY, |found| {
            let errors = (0..size).map(|row| (found[row] - truth[row]).abs() * scale(row));
            errors.fold(0.0, largest_or_nan)
        });
        worst = largest_or_nan(worst, error);
        if error.is_nan() || error > LIMIT {
            bad.push(format!("1e{exponent}: {error:e}"));
        }
    }
    let mut indefinite = BandMatrix::new(2, 1);
    indefinite.add(0, 0, 1.0);
    indefinite.add(1, 0, 2.0);
    indefinite.add(1, 1, 1.0);
    if indefinite.solve(&[1.0, 1.0]).is_some() {
        bad.push("an indefinite matrix has a solution".to_owned());
    }
    Checked {
        fault: (!bad.is_empty()).then(|| bad.join("; ")),
        error: Some([worst, LIMIT]),
    }
}

fn lift_ground() -> Checked {
    let plane = Plane {
        normal: DVec3::Z,
        offset: 0.0,
    };
    let above = dvec3(0.0, 0.0, 10.0);
    let rays = [
        ("along", above, DVec3::X),
        ("almost along", above, dvec3(1.0, 0.0, -1e-9)),
        ("away", above, DVec3::Z),
        ("from below, down", -above, -DVec3::Z),
        ("no direction", above, DVec3::ZERO),
        ("not finite", above, DVec3::NAN),
    ];
    let bad = rays
        .into_iter()
        .filter(|(_, centre, ray)| plane.meet(*centre, *ray).is_some())
        .map(|(name, ..)| name)
        .collect::<Vec<_>>()
        .join(", ");
    Checked::by((!bad.is_empty()).then(|| format!("a distance: {bad}")))
}

fn chains_crowd() -> Checked {
    let sighting = |seconds: f64, place: DVec2| Sighting {
        seconds,
        place,
        size: 3.0,
        is_cut: false,
    };
    let crowd = |frames: usize, count: usize, place: &dyn Fn(usize, usize) -> DVec2| {
        let all: Vec<Sighting> = (0..frames * count)
            .map(|n| sighting((n / count) as f64 * 0.2, place(n / count, n % count)))
            .collect();
        let numbers: Vec<Vec<usize>> = (0..frames)
            .map(|frame| (frame * count..(frame + 1) * count).collect())
            .collect();
        associate(&all, &numbers)
    };
    let mut bad = Vec::new();
    let grid = |frame: usize, n: usize| {
        dvec2((n % 25) as f64 * 12.0, (n / 25) as f64 * 12.0) + DVec2::X * (frame as f64)
    };
    let found = crowd(4, 500, &grid).len();
    if found != 500 {
        bad.push(format!("{found} of 500 vehicles"));
    }
    let in_one_place = crowd(4, 30, &|_, _| DVec2::ZERO);
    if in_one_place.iter().any(|chain| chain.len() > 4) {
        bad.push("a chain that is twice in a frame".to_owned());
    }
    if !crowd(4, 5, &|_, _| DVec2::NAN).is_empty() {
        bad.push("a chain of places that are not finite".to_owned());
    }
    if !associate(&[], &[]).is_empty() {
        bad.push("a chain of nothing".to_owned());
    }
    Checked::by((!bad.is_empty()).then(|| bad.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_passes() {
        for row in rows() {
            assert_eq!(
                row.status,
                StabilityStatus::Pass,
                "{}: {}",
                row.case,
                row.reason
            );
        }
    }
}
