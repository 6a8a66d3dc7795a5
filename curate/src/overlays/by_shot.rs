//! Finds of single shots, once boundaries are known: neither hidden by other shots nor spread to them.
//!
//! A boundary at which the pass saw no candidate cut, such as a slow transition, leaves shots that are judged together;
//! their span counts them.

use omnilife_schemas::records::{Boundary, Overlay, OverlayClass, OverlaySpan, TimeRange};

use super::{moving_mosaics::is_at_same_place, parts::shot_at, stability::Piece};

/// Content that stays in some shots alone has at least this mean gradient on its edges, 8-bit levels per pixel, or this
/// share of details that stay. Letters painted over `tunnel` have 34 levels at 45 % opacity and 104 opaque; over
/// `city4k`, 23 levels and 0.97. Skies and boards of single shots of `reef` have up to 22 and 0.87, so that this clip is
/// not unseen by the limits.
const LEAST_STROKE_LEVELS: f64 = 24.0;
const LEAST_STAYED: f64 = 0.9;
/// Least share of a caption's solid angle that an overlay has which stands for it. What stays of a lower third that is
/// painted over 8 of 18 looked-at frames of `tunnel` has 0.02 of it.
const LEAST_SHARE_OF_CAPTION: f64 = 0.25;

/// Returns the spans of the pieces, in order of time.
pub(super) fn spans(pieces: &[Piece], boundaries: &[Boundary]) -> Vec<OverlaySpan> {
    let span = |piece: &Piece| {
        let [first, last] = [piece.range.begin_seconds, piece.range.end_seconds]
            .map(|seconds| shot_at(boundaries, seconds));
        OverlaySpan {
            range: piece.range,
            first_shot: first as u32,
            shots: (last - first) as u32 + 1,
            moving_steps: piece.moving_steps,
            is_judged: piece.overlays.is_some(),
        }
    };
    pieces.iter().map(span).collect()
}

/// Returns the overlays of all pieces, each once with its times. A sky or a surfboard under the camera may stay for
/// a short shot, so what stays in some shots alone must have strokes as strong as letters, or stay as they do. What
/// carries the camera and patches under it need not, nor what stays in all judged shots of several.
pub(super) fn gathered(pieces: Vec<Piece>) -> Vec<Overlay> {
    let judged = pieces.iter().filter(|piece| piece.overlays.is_some());
    let judged = judged.count();
    let is_whole = judged <= 1;
    let is_clear = |overlay: &Overlay| {
        is_whole
            || !overlay.class.spoils_geometry()
            || overlay.strength_levels >= LEAST_STROKE_LEVELS
            || overlay.stayed >= LEAST_STAYED
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
            add(found, Overlay { ranges, ..overlay }, |known, seen| {
                known.class == seen.class
            });
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

/// Adds a find to those of other shots. Of two in one place that may join, the larger one stands for both, with the
/// sightings and times of both. One that passes in any shot is a caption.
pub(super) fn add(
    found: &mut Vec<Overlay>,
    mut seen: Overlay,
    may_join: impl Fn(&Overlay, &Overlay) -> bool,
) {
    let is_same = |known: &&mut Overlay| may_join(known, &seen) && is_at_same_place(known, &seen);
    let Some(known) = found.iter_mut().find(is_same) else {
        found.push(seen);
        return;
    };
    if let (Some(before), Some(now)) = (&known.sightings, &mut seen.sightings) {
        now.seen_frames += before.seen_frames;
    }
    if known.class != seen.class {
        [known.class, seen.class] = [OverlayClass::Caption; 2];
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

/// Returns true if an overlay that stays stands for a caption in its place and time. A few letters that stay for most of
/// a shot do not stand for all that passed.
pub(super) fn stands_for(standing: &Overlay, caption: &Overlay) -> bool {
    let least = LEAST_SHARE_OF_CAPTION * caption.solid_angle_steradians;
    standing.solid_angle_steradians >= least
        && is_at_same_place(standing, caption)
        && are_together(standing, caption)
}

/// Returns true if two overlays are seen at one time; one without times is seen at any.
fn are_together(one: &Overlay, other: &Overlay) -> bool {
    let overlap = |a: &TimeRange, b: &TimeRange| {
        a.begin_seconds < b.end_seconds && b.begin_seconds < a.end_seconds
    };
    one.ranges.is_empty()
        || other.ranges.is_empty()
        || (one.ranges.iter()).any(|a| other.ranges.iter().any(|b| overlap(a, b)))
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use std::ops::Range;

    use omnilife_schemas::records::{BoundaryKind, OverlayReport};
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
        let found = screened(&shot(1, 0..16, 16), &[]);
        assert_eq!(found.overlays.len(), 1, "{found:#?}");
        assert!(is_the_letters(&found.overlays[0]));
        assert_eq!(found.spans.len(), 1);
        assert_eq!((found.spans[0].shots, found.moving_steps), (1, 15));
        assert_eq!(found.overlays[0].ranges, [found.spans[0].range]);
        assert!(screened(&shot(1, 0..0, 16), &[]).overlays.is_empty());
    }

    /// Half as long as the shot without letters, then twice as long.
    #[test]
    fn letters_of_one_shot_are_neither_hidden_by_another_nor_spread_to_it() {
        for (first, second) in [(14, 28), (28, 14)] {
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
        let frames = [shot(1, 0..14, 14), shot(2, 0..14, 14)].concat();
        let found = screened(&frames, &[14]);
        assert_eq!(found.overlays.len(), 1, "{found:#?}");
        assert_eq!(found.overlays[0].ranges.len(), 2);
    }

    /// The scene changes at once, as a flight over a city may, and the boundary detector knows better.
    #[test]
    fn captions_of_a_shot_have_its_times() {
        let frames = [shot(1, 0..0, 16), shot(2, 4..9, 14)].concat();
        let found = screened(&frames, &[16]);
        assert_eq!(found.overlays.len(), 1, "{found:#?}");
        assert_eq!(found.overlays[0].class, OverlayClass::Caption);
        let sightings = found.overlays[0].sightings.as_ref().unwrap();
        assert_eq!((sightings.seen_frames, sightings.looked_at_frames), (5, 30));
        let ranges = &found.overlays[0].ranges;
        assert!((ranges[0].begin_seconds - 20.0 * STEP_SECONDS).abs() < 1e-9);
        assert!((ranges[0].end_seconds - 24.0 * STEP_SECONDS).abs() < 1e-9);
    }

    #[test]
    fn a_false_candidate_changes_no_find() {
        let frames = [shot(1, 0..10, 10), shot(2, 0..10, 10)].concat();
        let found = screened(&frames, &[]);
        assert_eq!(found.overlays.len(), 1, "{found:#?}");
        assert!(is_the_letters(&found.overlays[0]));
        assert_eq!(found.spans.len(), 1);
        assert_eq!((found.spans[0].shots, found.moving_steps), (1, 19));
    }

    #[test]
    fn shots_are_numbered_and_named_by_their_finds() {
        let frames = [shot(1, 0..0, 14), shot(2, 0..14, 14)].concat();
        let found = screened(&frames, &[14]);
        let numbers: Vec<u32> = found.spans.iter().map(|span| span.first_shot).collect();
        assert_eq!(numbers, [0, 1]);
        assert_eq!(found.overlays.len(), 1, "{found:#?}");
        let spans: Vec<u32> = (found.spans_of(&found.overlays[0]))
            .map(|span| span.first_shot)
            .collect();
        assert_eq!(spans, [1]);
    }

    #[test]
    fn a_piece_of_a_caption_does_not_stand_for_it() {
        let sized = |solid_angle_steradians: f64| Overlay {
            solid_angle_steradians,
            ..standing(60.0)
        };
        assert!(!stands_for(&sized(0.01), &sized(0.1)));
        assert!(stands_for(&sized(0.03), &sized(0.1)));
        let later = |begin: f64, steradians: f64| Overlay {
            ranges: vec![TimeRange::new(begin, begin + 1.0)],
            ..sized(steradians)
        };
        assert!(stands_for(&later(0.0, 0.1), &later(0.5, 0.1)));
        assert!(!stands_for(&later(0.0, 0.1), &later(2.0, 0.1)));
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
            extent_degrees: None,
            constancy: 1.0,
            stayed: 0.85,
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
    fn what_stays_faintly_but_nearly_always_is_found_in_one_shot() {
        let mut shots = pieces(&[&[10.0], &[]]);
        for overlay in shots[0].overlays.iter_mut().flatten() {
            overlay.stayed = 0.95;
        }
        assert_eq!(gathered(shots).len(), 1);
    }

    #[test]
    fn shots_of_few_steps_are_not_judged() {
        let frames = [shot(1, 0..5, 5), shot(2, 0..0, 16)].concat();
        let found = screened(&frames, &[5]);
        let judged: Vec<bool> = found.spans.iter().map(|span| span.is_judged).collect();
        assert_eq!(judged, [false, true]);
        assert_eq!(found.unjudged, None);
        assert!(screened(&frames[..5], &[]).unjudged.is_some());
    }

    #[test]
    fn shots_that_are_all_too_short_are_judged_together() {
        let frames = [shot(1, 0..9, 9), shot(2, 0..9, 9), shot(3, 0..9, 9)].concat();
        let found = screened(&frames, &[9, 18]);
        assert_eq!(found.unjudged, None);
        assert_eq!(found.spans.len(), 1, "{found:#?}");
        assert_eq!((found.spans[0].first_shot, found.spans[0].shots), (0, 3));
        assert!(found.overlays.iter().any(is_the_letters), "{found:#?}");
    }
}
