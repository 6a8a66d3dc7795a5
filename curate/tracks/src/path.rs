//! From the detections of an object to its path and its life.

use omnilife_schemas::{
    ground_plane::Plane,
    records::{Detection, Track},
    statistics,
    trajectory::GroundAxes,
};

use super::{
    Tracking, boxes, is_cut, middle,
    spline_fit::{self, Observation},
    within_image,
};

/// Factor on the uncertainty of a box cut off by the border of the image.
const SLACK_CUT: f64 = 6.0;
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
        let mut boxes = Vec::new();
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
                if !is_cut {
                    boxes.push((view, detection.box_pixels));
                }
            }
        }
        let seconds = observations.first().map_or(0.0, |first| first.view.seconds);
        let named = format!("the object first seen at {seconds:.2} s");
        let kept = without_cut_ends(&observations);
        let fitted = spline_fit::fit(kept, sigma_distance)
            .ok_or_else(|| format!("{named} has no path that fits its detections"))?;
        let [first, last] = fitted.spline.range();
        let begin = fitted.spline.position(first);
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
        let axes = GroundAxes::new(plane.normal);
        let [begin, end] = self.life(&observations);
        let extended = fitted.spline.extended(first - begin, end - last);
        let path = boxes::with_headings(extended, &axes, self.metres_per_unit);
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
    fn spread(
        &self,
        observations: &[Observation<'_>],
        spline: &omnilife_schemas::trajectory::BSpline,
    ) -> f64 {
        let distances: Vec<f64> = observations
            .iter()
            .map(|one| one.position().distance(spline.position(one.view.seconds)))
            .collect();
        statistics::median(&distances).unwrap_or(0.0)
    }
}

/// Returns observations without those of boxes cut off at either end, if enough remain and whole ones are near in time.
fn without_cut_ends<'o, 'v>(observations: &'o [Observation<'v>]) -> &'o [Observation<'v>] {
    let is_whole = |one: &Observation<'_>| one.slack <= 1.0;
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
}
