use std::ops::Range;

use omnilife_schemas::records::BoundaryKind;
use omnilife_video::Rgb8Image;

use super::super::OverlayPass;
use super::*;

const WIDTH: usize = 512;
const HEIGHT: usize = 256;
const SAMPLE_SECONDS: f64 = 0.2;

/// Letters in columns from `left` on, 80 of them, rows 120 to 136.
fn is_letters(left: usize, x: usize, y: usize) -> bool {
    (x + WIDTH - left) % WIDTH < 80 && (120..136).contains(&y)
}

/// Grain of a scene, another one for each number, with letters from a column on where there are any.
fn frame(grain: usize, letters: Option<usize>) -> Rgb8Image {
    let level = |at: usize| {
        let (x, y) = (at % WIDTH, at / WIDTH);
        if letters.is_some_and(|left| is_letters(left, x, y)) {
            return if (x / 3).is_multiple_of(2) { 250 } else { 10 };
        }
        let mixed = (at + 1).wrapping_mul(2_654_435_761) ^ (grain + 1).wrapping_mul(40_503);
        let mixed = mixed.wrapping_mul(mixed | 1);
        ((mixed >> 13) % 200) as u8
    };
    let data = (0..WIDTH * HEIGHT).flat_map(|at| [level(at); 3]);
    Rgb8Image::new(WIDTH, HEIGHT, data.collect())
}

/// Returns the captions of frames, each with its grain and letters.
fn found(
    frames: usize,
    boundaries: &[Boundary],
    shown: impl Fn(usize) -> (usize, Option<usize>),
) -> Vec<Overlay> {
    let mut pass = OverlayPass::default();
    let (mut moving_steps, mut last) = (0, None);
    for number in 0..frames {
        let (grain, letters) = shown(number);
        pass.observe(number as f64 * SAMPLE_SECONDS, &frame(grain, letters));
        moving_steps += u32::from(last.is_some_and(|last| last != grain));
        last = Some(grain);
    }
    let span = OverlaySpan {
        range: TimeRange::new(0.0, frames as f64 * SAMPLE_SECONDS),
        first_shot: 0,
        shots: 1,
        moving_steps,
        is_judged: moving_steps >= 12,
    };
    pass.captions().captions(boundaries, &[span])
}

fn painted(frames: usize, left: usize, letters: Range<usize>) -> Vec<Overlay> {
    found(frames, &[], |number| {
        (number, letters.contains(&number).then_some(left))
    })
}

fn cut_before(number: usize) -> Boundary {
    let seconds = number as f64 * SAMPLE_SECONDS;
    Boundary {
        begin_seconds: seconds - 0.04,
        end_seconds: seconds,
        kind: BoundaryKind::Cut,
        score: 1.0,
    }
}

fn assert_near(found: f64, expected: f64, limit: f64) {
    assert!((found - expected).abs() <= limit, "{found}, not {expected}");
}

/// One of 0.8 s, and one across the seam.
#[test]
fn a_caption_has_its_rectangle_and_times() {
    for (left, middle) in [(200, -11.25), (470, 178.59)] {
        let all = painted(20, left, 6..10);
        assert_eq!(all.len(), 1, "{all:?}");
        let caption = &all[0];
        assert_eq!(caption.class, OverlayClass::Caption);
        // Strokes end a pixel before the letters do.
        assert_near(caption.longitude_degrees, middle, 3.0);
        assert_near(caption.latitude_degrees, 0.0, 1.5);
        let [width, height] = caption.extent_degrees.unwrap_or_default();
        assert_near(width, 56.25, 4.0);
        assert_near(height, 11.25, 1.5);
        assert_near(caption.ranges[0].begin_seconds, 1.2, 1e-9);
        assert_near(caption.ranges[0].end_seconds, 1.8, 1e-9);
        let sightings = caption.sightings.as_ref();
        let counts = sightings.map(|seen| (seen.seen_frames, seen.looked_at_frames));
        assert_eq!(counts, Some((4, 20)));
    }
}

#[test]
fn what_is_shown_for_half_a_second_or_never_is_none() {
    assert!(painted(20, 200, 0..0).is_empty());
    assert!(painted(20, 200, 6..9).is_empty());
}

/// The camera rests for a second over a scene: strokes everywhere begin and end together, letters among them.
#[test]
fn a_resting_camera_shows_no_caption() {
    let all = found(24, &[], |number| {
        let grain = if (8..14).contains(&number) { 8 } else { number };
        (grain, None)
    });
    assert!(all.is_empty(), "{all:?}");
}

/// Over a scene that rests all the time, letters are the only strokes that come and go.
#[test]
fn a_caption_over_a_still_scene_is_found() {
    let all = found(24, &[], |number| {
        (0, (8..16).contains(&number).then_some(200))
    });
    assert_eq!(all.len(), 1, "{all:?}");
    assert_near(all[0].longitude_degrees, -11.25, 3.0);
}

/// A branch that an animal covers ends like a caption, and one that it uncovers begins like one, where a camera rests.
#[test]
fn strokes_of_a_still_scene_that_are_covered_or_uncovered_are_no_caption() {
    for shown in [0..12, 12..24] {
        let still = found(24, &[], |number| {
            (0, shown.contains(&number).then_some(200))
        });
        assert!(still.is_empty(), "{still:?}");
        // A camera that moves has no such branch.
        assert_eq!(painted(24, 200, shown).len(), 1);
    }
}

/// A camera's own mount stays for a shot of a second too, but a sign stays for a longer one.
#[test]
fn what_begins_and_ends_with_its_shot_must_last() {
    for (frames, class) in [(9, None), (14, Some(OverlayClass::Watermark))] {
        let shot = 10..10 + frames;
        let cuts = [cut_before(shot.start), cut_before(shot.end)];
        let all = found(shot.end + 10, &cuts, |number| {
            (number, shot.contains(&number).then_some(200))
        });
        assert_eq!(all.first().map(|found| found.class), class, "{all:?}");
    }
}

#[test]
fn captions_in_one_place_of_two_shots_are_one_with_both_times() {
    let all = found(40, &[cut_before(20)], |number| {
        let is_shown = (6..12).contains(&number) || (26..34).contains(&number);
        (number, is_shown.then_some(200))
    });
    assert_eq!(all.len(), 1, "{all:?}");
    assert_eq!(all[0].ranges.len(), 2);
    let seen = all[0].sightings.as_ref().map(|seen| seen.seen_frames);
    assert_eq!(seen, Some(6 + 8));
}

#[test]
fn rectangles_leave_sparse_borders_out_and_cross_the_seam() {
    let grid = Grid {
        width: 64,
        height: 32,
    };
    let block = (10..14).flat_map(|y| [60, 61, 62, 63, 0, 1].map(|x| y * 64 + x));
    // One pixel of six in the row below.
    let pixels: Vec<usize> = block.chain([14 * 64 + 61]).collect();
    let rectangle = Rectangle::around(&grid, &pixels);
    let expected = Rectangle {
        rows: 10..=13,
        left: 60,
        columns: 6,
    };
    assert_eq!(rectangle.as_ref(), Some(&expected));
    assert!(expected.has(&grid, 10 * 64 + 1) && !expected.has(&grid, 10 * 64 + 2));
    assert_eq!(expected.pixels(&grid).count(), 24);
    assert_eq!(expected.extent_degrees(&grid), [33.75, 22.5]);
    let [longitude, latitude] = expected.middle_degrees(&grid);
    assert_near(longitude, 174.375, 1e-9);
    assert_near(latitude, 22.5, 1e-9);
    assert!(Rectangle::around(&grid, &[]).is_none());
    let beside = |left: usize| Rectangle {
        left,
        ..expected.clone()
    };
    assert!(expected.overlaps(&beside(1), 64) && expected.overlaps(&beside(55), 64));
    assert!(!expected.overlaps(&beside(2), 64) && !expected.overlaps(&beside(54), 64));
}
