//! Finds of single shots, once boundaries are known: neither hidden by other shots nor spread to them.
//!
//! Sums over time end at candidate cuts (`cuts`), so that each of these pieces is judged alone. A boundary within a
//! piece, such as a slow transition, leaves shots that are judged together; their span counts them.

use omnilife_schemas::records::{Boundary, Overlay, OverlaySpan, TimeRange};

use super::{moving_mosaics::is_at_same_place, stability::Piece};

/// Least mean gradient on the edges of what stays in a part of a video alone, 8-bit levels per pixel. Stripes that are
/// painted over `tunnel` have 89 and more, translucent ones included. Skies and surfboards of single shots of `reef` have
/// 6 to 20, so that this clip is not unseen by the limit.
const LEAST_STROKE_LEVELS: f64 = 24.0;

/// Returns the number of the shot at an instant, from 0; a transition belongs to the nearer one.
pub(super) fn shot_at(boundaries: &[Boundary], seconds: f64) -> usize {
    let middle = |boundary: &Boundary| 0.5 * (boundary.begin_seconds + boundary.end_seconds);
    boundaries.partition_point(|boundary| middle(boundary) < seconds)
}

/// Returns the spans that were judged, in order of time.
pub(super) fn spans(pieces: &[Piece], boundaries: &[Boundary]) -> Vec<OverlaySpan> {
    let span = |piece: &Piece| {
        let [first, last] = [piece.range.begin_seconds, piece.range.end_seconds]
            .map(|seconds| shot_at(boundaries, seconds));
        OverlaySpan {
            range: piece.range,
            shots: (last - first) as u32 + 1,
            moving_steps: piece.moving_steps,
            is_judged: piece.overlays.is_some(),
        }
    };
    pieces.iter().map(span).collect()
}

/// Returns the overlays of all pieces, each once with its times. A sky or a surfboard under the camera may stay for
/// a short shot, so what stays in a part of the video alone must have strokes as strong as letters. What carries the
/// camera and patches under it need none, nor what stays in all judged parts of several.
pub(super) fn gathered(pieces: Vec<Piece>) -> Vec<Overlay> {
    let judged = pieces.iter().filter(|piece| piece.overlays.is_some());
    let judged = judged.count();
    let is_whole = judged <= 1;
    let is_clear = |overlay: &Overlay| {
        is_whole
            || !overlay.class.spoils_geometry()
            || overlay.strength_levels >= LEAST_STROKE_LEVELS
    };
    // Apart, so that a faint sky does not stand for letters in front of it.
    let (mut clear, mut faint): (Vec<Overlay>, Vec<Overlay>) = (Vec::new(), Vec::new());
    for piece in pieces {
        for overlay in piece.overlays.into_iter().flatten() {
            let ranges = vec![piece.range];
            let found = match is_clear(&overlay) {
                true => &mut clear,
                false => &mut faint,
            };
            add(found, Overlay { ranges, ..overlay });
        }
    }
    for overlay in clear.iter_mut().chain(&mut faint) {
        // Several of one piece in one place are one.
        overlay.ranges.dedup();
    }
    faint.retain(|overlay| judged > 1 && overlay.ranges.len() == judged);
    clear.append(&mut faint);
    clear
}

/// Adds a find to those of other shots; the larger one of a class in one place stands for both, with the sightings and
/// times of both.
pub(super) fn add(found: &mut Vec<Overlay>, mut seen: Overlay) {
    let is_same =
        |known: &&mut Overlay| known.class == seen.class && is_at_same_place(known, &seen);
    let Some(known) = found.iter_mut().find(is_same) else {
        found.push(seen);
        return;
    };
    if let (Some(before), Some(now)) = (&known.sightings, &mut seen.sightings) {
        now.seen_frames += before.seen_frames;
        now.looked_at_frames += before.looked_at_frames;
    }
    let mut ranges = std::mem::take(&mut known.ranges);
    ranges.append(&mut seen.ranges);
    if seen.solid_angle_steradians > known.solid_angle_steradians {
        *known = seen;
    } else {
        known.sightings = seen.sightings;
    }
    known.ranges = ranges;
}

/// Returns true if two overlays are seen at one time; one without times is seen at any.
pub(super) fn are_together(one: &Overlay, other: &Overlay) -> bool {
    let overlap = |a: &TimeRange, b: &TimeRange| {
        a.begin_seconds < b.end_seconds && b.begin_seconds < a.end_seconds
    };
    one.ranges.is_empty()
        || other.ranges.is_empty()
        || (one.ranges.iter()).any(|a| other.ranges.iter().any(|b| overlap(a, b)))
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use omnilife_schemas::records::{BoundaryKind, OverlayClass, OverlayReport};
    use omnilife_video::Rgb8Image;

    use super::super::{MosaicPass, OverlayPass, report};
    use super::*;

    const WIDTH: usize = 512;
    const HEIGHT: usize = 256;
    const STEP_SECONDS: f64 = 0.4;

    /// Random level below `range`, one for a place of a scene.
    fn random(scene: u32, x: usize, y: usize, range: u32) -> u32 {
        let mut bits = (x as u32).wrapping_mul(0x9e37_79b1)
            ^ (y as u32).wrapping_mul(0x85eb_ca77)
            ^ (scene + 1).wrapping_mul(0xc2b2_ae3d);
        for _ in 0..3 {
            bits = (bits ^ (bits >> 15)).wrapping_mul(0x2c1b_3c6d);
        }
        (bits >> 8) % range
    }

    /// A scene that flows by: patches with grain, or strokes of letters where they are painted.
    fn frame(scene: u32, number: usize, is_painted: bool) -> Rgb8Image {
        let level = |at: usize| {
            let (x, y) = (at % WIDTH, at / WIDTH);
            if is_painted && (200..280).contains(&x) && (120..136).contains(&y) {
                return if (x / 3).is_multiple_of(2) { 250 } else { 10 };
            }
            let (x, y) = ((x + 7 * number) % WIDTH, (y + 3 * number) % HEIGHT);
            let patch = random(scene, x / 64, y / 64, 120);
            (40 + patch + random(scene + 100, x / 2, y / 2, 70)) as u8
        };
        Rgb8Image {
            width: WIDTH,
            height: HEIGHT,
            data: (0..WIDTH * HEIGHT).flat_map(|at| [level(at); 3]).collect(),
        }
    }

    /// Screens frames, each by its scene and by what is painted, with boundaries between frames of these numbers.
    fn screened(frames: &[(u32, bool)], cuts: &[usize]) -> OverlayReport {
        let mut pass = OverlayPass::default();
        for (number, &(scene, is_painted)) in frames.iter().enumerate() {
            let image = frame(scene, number, is_painted);
            pass.observe(number as f64 * STEP_SECONDS, &image);
        }
        let boundary = |&cut: &usize| Boundary {
            begin_seconds: cut as f64 * STEP_SECONDS - 0.04,
            end_seconds: cut as f64 * STEP_SECONDS,
            kind: BoundaryKind::Cut,
            score: 1.0,
        };
        let boundaries: Vec<Boundary> = cuts.iter().map(boundary).collect();
        report(&pass, &MosaicPass::default(), &boundaries)
    }

    fn shot(scene: u32, painted: Range<usize>, frames: usize) -> Vec<(u32, bool)> {
        let frames = 0..frames;
        frames.map(|at| (scene, painted.contains(&at))).collect()
    }

    fn is_the_letters(overlay: &Overlay) -> bool {
        overlay.class.spoils_geometry()
            && (overlay.longitude_degrees + 11.25).abs() < 3.0
            && overlay.latitude_degrees.abs() < 3.0
    }

    #[test]
    fn letters_over_one_shot_are_found_in_it() {
        let found = screened(&shot(1, 0..12, 12), &[]);
        assert_eq!(found.overlays.len(), 1, "{found:#?}");
        assert!(is_the_letters(&found.overlays[0]));
        assert_eq!(found.spans.len(), 1);
        assert_eq!((found.spans[0].shots, found.moving_steps), (1, 11));
        assert_eq!(found.overlays[0].ranges, [found.spans[0].range]);
        assert!(screened(&shot(1, 0..0, 12), &[]).overlays.is_empty());
    }

    /// Half as long as the shot without letters, then four times as long.
    #[test]
    fn letters_of_one_shot_are_neither_hidden_by_another_nor_spread_to_it() {
        for (first, second) in [(8, 16), (24, 6)] {
            let frames = [shot(1, 0..first, first), shot(2, 0..0, second)].concat();
            let found = screened(&frames, &[first]);
            assert_eq!(found.overlays.len(), 1, "{found:#?}");
            assert!(is_the_letters(&found.overlays[0]));
            let end = (first - 1) as f64 * STEP_SECONDS;
            let ranges = &found.overlays[0].ranges;
            assert!(ranges.iter().all(|range| range.end_seconds < end + 1e-9));
            assert_eq!(found.spans.len(), 2);
            assert!(found.spans.iter().all(|span| span.shots == 1));
        }
    }

    #[test]
    fn letters_over_two_shots_are_one_overlay_with_both_times() {
        let frames = [shot(1, 0..10, 10), shot(2, 0..10, 10)].concat();
        let found = screened(&frames, &[10]);
        assert_eq!(found.overlays.len(), 1, "{found:#?}");
        assert_eq!(found.overlays[0].ranges.len(), 2);
    }

    /// A sky that stays for two steps in each of two shots, in the same place: one window each.
    #[test]
    fn a_sky_that_shots_share_is_no_caption() {
        let frames = [shot(1, 2..5, 9), shot(2, 2..5, 9)].concat();
        let found = screened(&frames, &[9]);
        assert!(found.overlays.is_empty(), "{found:#?}");
        // In one shot the same two windows are letters that come back.
        let frames = [shot(1, 2..5, 9), shot(1, 2..5, 9)].concat();
        let found = screened(&frames, &[]);
        assert_eq!(found.overlays.len(), 1, "{found:#?}");
        assert!(is_the_letters(&found.overlays[0]));
    }

    #[test]
    fn shots_that_look_alike_are_judged_together_and_counted() {
        let found = screened(&shot(1, 0..0, 12), &[6]);
        assert_eq!(found.spans.len(), 1);
        assert_eq!(found.spans[0].shots, 2);
    }

    fn standing(strength_levels: f64) -> Overlay {
        Overlay {
            class: OverlayClass::Watermark,
            longitude_degrees: 10.0,
            latitude_degrees: 20.0,
            solid_angle_steradians: 0.1,
            constancy: 1.0,
            stayed: 1.0,
            strength_levels,
            variation_levels: 0.0,
            saturated_share: 0.0,
            sightings: None,
            ranges: Vec::new(),
        }
    }

    /// Number of overlays of shots, each with finds of these strengths in one place.
    fn counts(shots: &[&[f64]]) -> usize {
        gathered(pieces(shots)).len()
    }

    fn pieces(shots: &[&[f64]]) -> Vec<Piece> {
        let mut pieces = Vec::new();
        for (number, strengths) in shots.iter().enumerate() {
            let finds = strengths.iter().map(|&strength| standing(strength));
            pieces.push(Piece {
                range: TimeRange {
                    begin_seconds: number as f64,
                    end_seconds: number as f64 + 0.5,
                },
                moving_steps: 9,
                overlays: Some(finds.collect()),
            });
        }
        pieces
    }

    /// A shot that is too short to be judged beside one that is.
    #[test]
    fn what_stays_faintly_in_the_only_judged_shot_is_kept() {
        let mut shots = pieces(&[&[10.0], &[]]);
        shots[1].overlays = None;
        assert_eq!(gathered(shots).len(), 1);
    }

    #[test]
    fn what_stays_faintly_must_stay_in_all_shots() {
        assert_eq!(counts(&[&[10.0]]), 1);
        assert_eq!(counts(&[&[10.0], &[]]), 0);
        assert_eq!(counts(&[&[10.0, 10.0], &[]]), 0);
        assert_eq!(counts(&[&[60.0], &[]]), 1);
        assert_eq!(counts(&[&[60.0], &[10.0]]), 1);
        assert_eq!(counts(&[&[10.0], &[10.0]]), 1);
        assert_eq!(counts(&[&[10.0], &[10.0], &[]]), 0);
    }

    #[test]
    fn shots_of_few_steps_are_not_judged() {
        let frames = [shot(1, 0..5, 5), shot(2, 0..0, 12)].concat();
        let found = screened(&frames, &[5]);
        let judged: Vec<bool> = found.spans.iter().map(|span| span.is_judged).collect();
        assert_eq!(judged, [false, true]);
        assert_eq!(found.unjudged, None);
        assert!(screened(&frames[..5], &[]).unjudged.is_some());
    }
}
