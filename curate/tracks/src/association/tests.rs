use glam::dvec2;

use super::*;

/// Sightings of objects `(begin, velocity)` at some frames, less those that `is_missed`.
fn seen(
    objects: &[(DVec2, DVec2)],
    frames: usize,
    interval: f64,
    is_missed: impl Fn(usize, usize) -> bool,
) -> (Vec<Sighting>, Vec<Vec<usize>>, Vec<usize>) {
    let (mut sightings, mut by_frame, mut truth) = (Vec::new(), Vec::new(), Vec::new());
    for frame in 0..frames {
        let mut numbers = Vec::new();
        let seconds = frame as f64 * interval;
        for (object, &(begin, velocity)) in objects.iter().enumerate() {
            if !is_missed(frame, object) {
                numbers.push(sightings.len());
                truth.push(object);
                sightings.push(Sighting {
                    seconds,
                    place: begin + velocity * seconds,
                    size: 3.0,
                    is_cut: false,
                });
            }
        }
        by_frame.push(numbers);
    }
    (sightings, by_frame, truth)
}

#[test]
fn what_belongs_elsewhere_is_counted() {
    let one = [vec![0, 1, 2], vec![3, 4]];
    assert_eq!(changed(&one, &one, 6), 0);
    assert_eq!(changed(&one, &[vec![3, 4], vec![0, 1, 2]], 6), 0);
    // 2 has gone to 3 and 4: all five are with others now.
    assert_eq!(changed(&one, &[vec![0, 1], vec![2, 3, 4]], 6), 5);
    assert_eq!(changed(&one, &[vec![0, 1, 2], vec![3, 4, 5]], 6), 3);
}

#[test]
fn fast_objects_that_cross_keep_their_identity() {
    let objects = [
        (dvec2(-40.0, 0.0), dvec2(8.0, 0.0)),
        (dvec2(40.0, 3.0), dvec2(-8.0, 0.0)),
        (dvec2(0.5, -40.0), dvec2(0.0, 8.0)),
    ];
    let missed = |frame: usize, object: usize| (frame * 7 + object * 3) % 9 == 4;
    let (sightings, frames, truth) = seen(&objects, 11, 1.0, missed);
    let groups = associate(&sightings, &frames);
    assert_eq!(groups.len(), 3, "{groups:?}");
    for group in groups {
        assert!(group.iter().all(|&number| truth[number] == truth[group[0]]));
    }
}

#[test]
fn a_gap_is_stitched_and_one_too_long_is_not() {
    let object = [(dvec2(0.0, 0.0), dvec2(5.0, 1.0))];
    let gone = |from: usize, to: usize| move |frame: usize, _: usize| (from..to).contains(&frame);
    let (sightings, frames, _) = seen(&object, 20, 0.5, gone(6, 10));
    assert_eq!(associate(&sightings, &frames).len(), 1);
    let (sightings, frames, _) = seen(&object, 30, 0.5, gone(8, 18));
    assert_eq!(associate(&sightings, &frames).len(), 2);
}

#[test]
fn what_is_seen_once_or_twice_is_nothing() {
    let object = [(DVec2::ZERO, DVec2::X)];
    for count in [0, 1, 2] {
        let (sightings, frames, _) = seen(&object, count, 1.0, |_, _| false);
        assert!(associate(&sightings, &frames).is_empty());
    }
}

/// Lists every possible chain, for a small case.
#[test]
fn the_first_chain_is_the_best_of_all() {
    let objects = [
        (dvec2(-8.0, 0.0), dvec2(7.0, 0.4)),
        (dvec2(8.0, 2.0), dvec2(-6.0, 0.0)),
        (dvec2(0.0, -9.0), dvec2(0.3, 6.0)),
    ];
    let missed = |frame: usize, object: usize| frame == 2 && object == 0;
    let (sightings, frames, _) = seen(&objects, 4, 1.0, missed);
    let search = Search::new(&sightings, &frames);
    let mut all: Vec<Hypothesis> = Vec::new();
    let mut at = 0;
    let firsts = (0..sightings.len()).map(|number| search.first(number));
    all.extend(firsts);
    while at < all.len() {
        for number in 0..sightings.len() {
            let linked = search.linked(&all[at], number).map(|linked| Hypothesis {
                before: Some(at),
                ..linked
            });
            all.extend(linked);
        }
        at += 1;
    }
    let best = (0..all.len())
        .filter(|&at| all[at].count >= LEAST_DETECTIONS)
        .max_by(|&a, &b| all[a].score.total_cmp(&all[b].score));
    let best = best.map(|at| members(&all, at));
    assert_eq!(search.best().first().cloned(), best);
}

/// A car that is not seen while it waits at a light is one car; another that comes later is not the same.
#[test]
fn what_stops_is_found_again_at_its_place() {
    // 6 m/s, down to nothing from 4 s to 6 s, and up again from 12 s to 14 s.
    let along = |seconds: f64| {
        let slowing = (seconds.min(6.0) - 4.0).max(0.0);
        let starting = (seconds - 12.0).clamp(0.0, 2.0);
        let gone = (seconds - 14.0).max(0.0);
        6.0 * seconds.min(6.0) - 1.5 * slowing * slowing + 1.5 * starting * starting + 6.0 * gone
    };
    let sighting = |seconds: f64, y: f64| Sighting {
        seconds,
        place: dvec2(along(seconds), y),
        size: 3.0,
        is_cut: false,
    };
    let times = || (0..=6).chain(12..18).map(f64::from);
    let one_by_one: Vec<Vec<usize>> = (0..13).map(|number| vec![number]).collect();
    let one: Vec<Sighting> = times().map(|time| sighting(time, 0.0)).collect();
    assert_eq!(associate(&one, &one_by_one).len(), 1);
    let other: Vec<Sighting> = times()
        .map(|time| sighting(time, if time > 8.0 { 7.0 } else { 0.0 }))
        .collect();
    assert_eq!(associate(&other, &one_by_one).len(), 2);
}

/// A lorry and a car that meet do not change places.
#[test]
fn sizes_tell_what_places_do_not() {
    let mut sightings = Vec::new();
    let mut frames = Vec::new();
    for frame in 0..8 {
        let seconds = f64::from(frame);
        frames.push(vec![2 * frame as usize, 2 * frame as usize + 1]);
        for (side, size) in [(1.0, 2.6), (-1.0, 5.5)] {
            sightings.push(Sighting {
                seconds,
                place: dvec2(5.0 * seconds, side * 0.1 * (f64::from(frame) - 3.5)),
                size,
                is_cut: false,
            });
        }
    }
    let groups = associate(&sightings, &frames);
    assert_eq!(groups.len(), 2, "{groups:?}");
    for group in groups {
        assert!(
            group.iter().all(|&number| number % 2 == group[0] % 2),
            "{group:?}"
        );
    }
}

#[test]
fn sizes_count_by_the_logarithm_of_their_ratio() {
    let of_size = |size: f64| Sighting {
        seconds: 0.0,
        place: DVec2::ZERO,
        size,
        is_cut: false,
    };
    let alike = of_size(2.0).size_likeness(&of_size(2.0));
    let expected = 0.5 * (1.5_f64.ln() / SIZE_SPREAD).powi(2);
    for (one, other) in [(2.0, 3.0), (3.0, 2.0)] {
        let lost = alike - of_size(one).size_likeness(&of_size(other));
        assert!((lost - expected).abs() < 1e-12, "{lost} {expected}");
    }
}
