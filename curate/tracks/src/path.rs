//! From the detections of an object to its path and its life.

use omnilife_schemas::{
    camera::Camera,
    ground_plane::Plane,
    records::{Detection, Track},
    statistics,
    trajectory::{BSpline, GroundAxes, ObjectPath},
};

use super::{
    Tracking, boxes,
    image_boxes::{shift_of_ends, shown_box},
    is_cut, middle,
    spline_fit::{self, Observation},
    within_image,
};

/// Factor on the uncertainty of a box cut off by the border of the image.
const SLACK_CUT: f64 = 6.0;
/// The same where its middle is that of the whole box.
const SLACK_COMPLETED: f64 = 1.5;
/// The same of a box with other sides than those of the vehicle: it holds another one too, or a part.
const SLACK_OTHER: f64 = 5.0;
/// Largest ratio between the half perimeters of the box of a vehicle and of its detection.
const LARGEST_RATIO: f64 = 1.5;
/// Fits with judged boxes, after one without.
const JUDGED_FITS: usize = 2;
/// Longest time to a whole box for leaving boxes cut off at an end of a path out of its fit, seconds. Straight
/// continuation is nearer to the truth than their middles.
const LONGEST_CUT: f64 = 2.0;
/// Least number of boxes in a fit.
const LEAST_WHOLE: usize = 4;
/// Longest extension of paths before and after their detections, seconds.
const LONGEST_EXTENSION: f64 = 1.0;
/// Largest displacement of a static object, metres.
const LEAST_DISPLACEMENT: f64 = 1.0;

impl Tracking<'_> {
    /// Returns the track of a group of detections, whose distances have a relative standard deviation; the reason if it
    /// does not move.
    pub(super) fn track(
        &self,
        id: u32,
        group: &[usize],
        detections: &[Detection],
        plane: Plane,
        sigma_distance: f64,
    ) -> Result<Track, String> {
        let mut observations = Vec::new();
        let (mut boxes, mut found) = (Vec::new(), Vec::new());
        for &number in group {
            let detection = &detections[number];
            if let (Some(view), Some(distance)) = (self.view(detection.frame), detection.distance) {
                let pixel = middle(detection.box_pixels);
                let is_cut = is_cut(view, detection.box_pixels);
                observations.push(Observation {
                    view,
                    pixel,
                    distance,
                    slack: if is_cut { SLACK_CUT } else { 1.0 },
                });
                found.push(detection.box_pixels);
                if !is_cut {
                    boxes.push((view, detection.box_pixels));
                }
            }
        }
        let seconds = observations.first().map_or(0.0, |first| first.view.seconds);
        let named = format!("the object first seen at {seconds:.2} s");
        let axes = GroundAxes::new(plane.normal);
        let fit = |observations: &[Observation<'_>]| {
            spline_fit::fit(without_cut_ends(observations), sigma_distance)
                .ok_or_else(|| format!("{named} has no path that fits its detections"))
        };
        let mut fitted = fit(&observations)?;
        for _ in 0..JUDGED_FITS {
            let path = self.lived(&fitted.spline, &observations, &axes);
            let metres = boxes::dimensions(&path, &axes, &boxes, self.metres_per_unit);
            let sides = metres.map(|side| side / self.metres_per_unit);
            let mut judgements = observations.clone();
            for (observation, found) in judgements.iter_mut().zip(&found) {
                let judgement = judged(observation, *found, (&path, &axes), sides);
                *observation = judgement.unwrap_or(*observation);
            }
            if judgements == observations {
                break;
            }
            observations = judgements;
            fitted = fit(&observations)?;
        }
        let kept = without_cut_ends(&observations);
        let begin = fitted.spline.position(fitted.spline.range()[0]);
        let positions = kept
            .iter()
            .map(|one| fitted.spline.position(one.view.seconds));
        let farthest = positions
            .map(|place| place.distance(begin))
            .fold(0.0, f64::max);
        let spread = self.spread(kept, &fitted.spline);
        if farthest * self.metres_per_unit < LEAST_DISPLACEMENT || farthest < 3.0 * spread {
            return Err(format!(
                "{named} moves {:.2} m at most and counts as static",
                farthest * self.metres_per_unit
            ));
        }
        let path = self.lived(&fitted.spline, &observations, &axes);
        let metres = boxes::dimensions(&path, &axes, &boxes, self.metres_per_unit);
        let class = detections[group[0]].class.clone();
        Ok(Track {
            id,
            class,
            dimensions: metres.map(|side| side / self.metres_per_unit),
            path,
            detections: group.len() as u32,
            displacement: farthest,
        })
    }

    /// Returns the path of an object over its life.
    fn lived(
        &self,
        spline: &BSpline,
        observations: &[Observation<'_>],
        axes: &GroundAxes,
    ) -> ObjectPath {
        let [first, last] = spline.range();
        let [begin, end] = self.life(observations);
        let extended = spline.clone().extended(first - begin, end - last);
        boxes::with_headings(extended, axes, self.metres_per_unit)
    }

    /// Returns start and end of an object's life, seconds. It was missing in the frames before and after its
    /// detections, and came and went in between.
    fn life(&self, observations: &[Observation<'_>]) -> [f64; 2] {
        let times = || self.views.iter().map(|view| view.seconds);
        let first = observations.first().map_or(0.0, |one| one.view.seconds);
        let last = observations.last().map_or(0.0, |one| one.view.seconds);
        // Without such frames there is no evidence of an end.
        let extension = |gap: f64| {
            if gap.is_finite() {
                (0.95 * gap).min(LONGEST_EXTENSION)
            } else {
                0.0
            }
        };
        let before = times()
            .filter(|&time| time < first)
            .map(|time| first - time);
        let after = times().filter(|&time| time > last).map(|time| time - last);
        [
            first - extension(before.fold(f64::INFINITY, f64::min)),
            last + extension(after.fold(f64::INFINITY, f64::min)),
        ]
    }

    /// Returns boxes of a track in the frames of its life without a detection.
    pub(super) fn filled(
        &self,
        track: &Track,
        detections: &[Detection],
        plane: Plane,
    ) -> Vec<Detection> {
        let axes = GroundAxes::new(plane.normal);
        let own = || detections.iter().filter(|one| one.track == Some(track.id));
        let seen: Vec<u32> = own().map(|one| one.frame).collect();
        let (Some(&first), Some(&last)) = (seen.iter().min(), seen.iter().max()) else {
            return Vec::new();
        };
        let missed = self
            .views
            .iter()
            .filter(|view| (first..=last).contains(&view.frame) && !seen.contains(&view.frame));
        let filled = missed.filter_map(|view| {
            let (centre, heading) = track.path.at(view.seconds)?;
            let sides =
                boxes::projected_box(view, centre, axes.rotation(heading), track.dimensions)?;
            Some(Detection {
                frame: view.frame,
                box_pixels: within_image(view, sides)?,
                confidence: 0.0,
                class: track.class.clone(),
                distance: Some(centre.distance(view.centre)),
                position: Some(centre.to_array()),
                track: Some(track.id),
            })
        });
        filled.collect()
    }

    /// Returns the median distance of lifted detections from their path.
    fn spread(&self, observations: &[Observation<'_>], spline: &BSpline) -> f64 {
        let distances: Vec<f64> = observations
            .iter()
            .map(|one| one.position().distance(spline.position(one.view.seconds)))
            .collect();
        statistics::median(&distances).unwrap_or(0.0)
    }
}

/// Returns an observation as an object of these sides on this path judges it: a box that the border of the image cuts off
/// has the middle of the whole one, and a box of other sides is uncertain. `None` in panoramas, and where the path says
/// nothing of it.
fn judged<'v>(
    observation: &Observation<'v>,
    found: [f64; 4],
    (path, axes): (&ObjectPath, &GroundAxes),
    sides: [f64; 3],
) -> Option<Observation<'v>> {
    let view = observation.view;
    if !matches!(view.camera, Camera::Pinhole(_)) {
        return None;
    }
    let (centre, heading) = path.at(view.seconds)?;
    let rotation = axes.rotation(heading);
    let edges = boxes::projected_edges(view, centre, rotation, sides)?;
    let shown = shown_box(view, edges.into_iter())?;
    let size = |[_, _, width, height]: [f64; 4]| width + height;
    let [large, small] = [size(found).max(size(shown)), size(found).min(size(shown))];
    let is_other = large > LARGEST_RATIO * small;
    if !is_cut(view, found) {
        let slack = if is_other { SLACK_OTHER } else { 1.0 };
        return Some(Observation {
            slack,
            ..*observation
        });
    }
    if is_other {
        return None;
    }
    let predicted = middle(boxes::projected_box(view, centre, rotation, sides)?);
    let pixel = predicted + shift_of_ends(view, found, shown)?;
    // At the height of the middle that was found.
    let up = axes.to_world.z_axis;
    let height = (observation.position() - view.centre).dot(up);
    let distance = height / view.ray(pixel).dot(up);
    (distance.is_finite() && distance > 0.0).then_some(Observation {
        view,
        pixel,
        distance,
        slack: SLACK_COMPLETED,
    })
}

/// Returns observations without those of boxes cut off at either end, if enough remain and whole ones are near in time.
fn without_cut_ends<'o, 'v>(observations: &'o [Observation<'v>]) -> &'o [Observation<'v>] {
    let is_whole = |one: &Observation<'_>| one.slack < SLACK_CUT;
    let (Some(mut first), Some(mut last)) = (
        observations.iter().position(is_whole),
        observations.iter().rposition(is_whole),
    ) else {
        return observations;
    };
    let seconds = |at: usize| observations[at].view.seconds;
    if seconds(first) - seconds(0) > LONGEST_CUT {
        first = 0;
    }
    if seconds(observations.len() - 1) - seconds(last) > LONGEST_CUT {
        last = observations.len() - 1;
    }
    if last + 1 - first < LEAST_WHOLE {
        return observations;
    }
    &observations[first..=last]
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec2, DVec3};
    use omnilife_schemas::camera::PinholeCamera;

    use super::*;
    use omnilife_schemas::posed_view::PosedView;

    #[test]
    fn cut_ends_are_left_out_where_whole_boxes_are_near() {
        let views: Vec<PosedView> = (0..8)
            .map(|frame| PosedView {
                frame,
                seconds: f64::from(frame),
                camera: PinholeCamera::with_horizontal_field_of_view(320, 180, 1.1).into(),
                to_world: DMat3::IDENTITY,
                centre: DVec3::ZERO,
            })
            .collect();
        let kept = |cut: [bool; 8]| {
            let observations: Vec<Observation<'_>> = views
                .iter()
                .zip(cut)
                .map(|(view, is_cut)| Observation {
                    view,
                    pixel: DVec2::ZERO,
                    distance: 1.0,
                    slack: if is_cut { SLACK_CUT } else { 1.0 },
                })
                .collect();
            let kept = without_cut_ends(&observations);
            [kept[0].view.frame, kept[kept.len() - 1].view.frame]
        };
        let [t, f] = [true, false];
        assert_eq!(kept([t, f, f, f, f, f, t, t]), [1, 5]);
        // One in the middle stays, and so does a long run of them: it stands at the border.
        assert_eq!(kept([t, f, f, t, f, f, f, f]), [1, 7]);
        assert_eq!(kept([t, t, t, f, f, f, f, f]), [0, 7]);
        assert_eq!(kept([t, t, f, f, f, t, t, f]), [2, 7]);
        assert_eq!(kept([f, f, f, t, t, t, t, t]), [0, 7]);
        // Too few would remain.
        assert_eq!(kept([f, t, t, t, t, t, t, t]), [0, 7]);
        assert_eq!(kept([t; 8]), [0, 7]);
    }

    /// A camera that looks straight down from 40 m.
    fn from_above() -> PosedView {
        PosedView {
            frame: 0,
            seconds: 1.0,
            camera: PinholeCamera::with_horizontal_field_of_view(640, 360, 1.1).into(),
            to_world: DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z),
            centre: DVec3::Z * 40.0,
        }
    }

    /// A car drives into the image from the left, seen from 40 m above: its middle is where it is, though the border
    /// cuts off all but a part of it.
    #[test]
    fn cut_boxes_give_the_middle_of_the_whole_vehicle() {
        let view = from_above();
        let axes = GroundAxes::new(DVec3::Z);
        let sides = [4.5, 1.8, 1.5];
        let half = 40.0 * 0.55_f64.tan();
        for (shown, heading) in [(1.0, 0.0), (3.0, 0.3), (2.0, -0.4)] {
            let truth = DVec3::new(shown - half - 2.25, 3.0, 0.75);
            let of_heading = axes.rotation(heading);
            let edges = boxes::projected_edges(&view, truth, of_heading, sides);
            let found = edges.and_then(|edges| shown_box(&view, edges.into_iter()));
            let Some(found) = found else {
                panic!("a part is in the image");
            };
            // The path before its refit is half a metre behind.
            let path = ObjectPath {
                centre: BSpline {
                    degree: 0,
                    knots: vec![0.0, 2.0],
                    coefficients: vec![(truth - DVec3::X * 0.5).to_array()],
                },
                headings: vec![heading],
                heading_seconds: vec![0.0],
            };
            let pixel = middle(found);
            let observation = Observation {
                view: &view,
                pixel,
                distance: (40.0 - 0.75) / -view.ray(pixel).z,
                slack: SLACK_CUT,
            };
            assert!(
                observation.position().distance(truth) > 0.6,
                "{shown} m are shown"
            );
            let whole = judged(&observation, found, (&path, &axes), sides);
            let off = whole.map(|whole| whole.position().distance(truth));
            // The middle of a whole box is not that of the vehicle either: it has a height.
            assert!(
                off.is_some_and(|off| off < 0.2),
                "{shown} m are shown: {off:?}"
            );
            let larger = [found[0], found[1], 2.0 * found[2], 2.0 * found[3]];
            assert_eq!(judged(&observation, larger, (&path, &axes), sides), None);
            let across = [0.0, 100.0, 640.0, 20.0];
            assert_eq!(judged(&observation, across, (&path, &axes), sides), None);
        }
    }

    /// A box around two vehicles is uncertain, and one around the vehicle is not.
    #[test]
    fn boxes_of_other_sides_are_uncertain() {
        let view = from_above();
        let axes = GroundAxes::new(DVec3::Z);
        let sides = [4.5, 1.8, 1.5];
        let centre = DVec3::new(2.0, 1.0, 0.75);
        let path = ObjectPath {
            centre: BSpline {
                degree: 0,
                knots: vec![0.0, 2.0],
                coefficients: vec![centre.to_array()],
            },
            headings: vec![0.1],
            heading_seconds: vec![0.0],
        };
        let own = boxes::projected_box(&view, centre, axes.rotation(0.1), sides);
        let Some([left, top, width, height]) = own else {
            panic!("it is in front of the camera");
        };
        let observation = Observation {
            view: &view,
            pixel: middle([left, top, width, height]),
            distance: 39.0,
            slack: 1.0,
        };
        let slack = |found: [f64; 4]| {
            judged(&observation, found, (&path, &axes), sides).map(|one| one.slack)
        };
        assert_eq!(slack([left, top, width + 8.0, height]), Some(1.0));
        assert_eq!(slack([left, top, width, 3.0 * height]), Some(SLACK_OTHER));
        assert_eq!(slack([left, top, 0.4 * width, height]), Some(SLACK_OTHER));
    }
}
