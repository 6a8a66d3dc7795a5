//! Alignment of a textured disc with moved, turned and hidden copies.

use super::*;

/// Returns a texture without a direction of its own.
fn texture(at: DVec2) -> f64 {
    0.5 + 0.15 * (31.0 * at.x + 9.0 * at.y).sin()
        + 0.15 * (13.0 * at.x - 27.0 * at.y + 1.0).cos()
        + 0.1 * (19.0 * at.x * (1.0 + at.y)).sin()
}

fn disc(at: DVec2) -> f64 {
    if at.length() < 0.25 { 1.0 } else { 0.0 }
}

fn patch(draw: impl Fn(DVec2) -> [f64; 2]) -> Vec<Patch> {
    Patch::drawn(DVec2::splat(-0.5), 0.008, [126, 126], draw).pyramid(16, 4)
}

fn template() -> Vec<Template> {
    Template::pyramid(&patch(|at| [texture(at), disc(at)]), DVec2::ZERO)
}

/// Returns the disc moved by a similarity, in another light; `hide` changes grey value and coverage in the
/// disc's own coordinates.
fn moved(by: &PlanarSimilarity, hide: impl Fn(DVec2, [f64; 2]) -> [f64; 2]) -> Vec<Patch> {
    let back = by.inverse();
    patch(|at| {
        let own = back.apply(at);
        hide(own, [0.9 * texture(own) + 0.04, disc(own)])
    })
}

fn apart(found: &PlanarSimilarity, truth: &PlanarSimilarity) -> [f64; 3] {
    let turn = quotient(found.turn, truth.turn);
    [
        (turn.length() - 1.0).abs(),
        turn.y.atan2(turn.x).abs(),
        found.shift.distance(truth.shift),
    ]
}

#[test]
fn similarities_compose_and_invert() {
    let a = PlanarSimilarity::new(1.3, 0.7, DVec2::new(0.2, -0.1));
    let b = PlanarSimilarity::new(0.6, -2.9, DVec2::new(-0.5, 0.4));
    for at in [DVec2::ZERO, DVec2::new(0.3, -2.0)] {
        assert!(a.after(&b).apply(at).distance(a.apply(b.apply(at))) < 1e-14);
        assert!(a.inverse().apply(a.apply(at)).distance(at) < 1e-14);
    }
    assert!((a.angle() - 0.7).abs() < 1e-14 && (b.scale() - 0.6).abs() < 1e-14);
}

#[test]
fn rows_are_central_differences() {
    // Fine samples: the patch's own differences have an error of the square of their distance.
    let fine = Patch::drawn(DVec2::splat(-0.1), 1e-4, [200, 200], |at| {
        [texture(at), 1.0]
    });
    let template = Template::of(&fine, DVec2::new(0.02, -0.03)).expect("enough samples");
    let centre = DVec2::new(0.02, -0.03);
    let step = 1e-6;
    for point in template.points.iter().step_by(97) {
        let at = |unknown: usize, by: f64| {
            let mut z = [0.0; 4];
            z[unknown] = by;
            let by = PlanarSimilarity {
                turn: DVec2::new(1.0 + z[0], z[1]),
                shift: DVec2::new(z[2], z[3]),
            };
            texture(centre + by.apply(point.place))
        };
        for unknown in 0..4 {
            let expected = (at(unknown, step) - at(unknown, -step)) / (2.0 * step);
            let found = point.row[unknown];
            assert!(
                (found - expected).abs() < 1e-3,
                "{unknown}: {found} {expected}"
            );
        }
        assert_eq!(point.row[4..], [point.grey, 1.0]);
    }
}

#[test]
fn scale_and_rotation_are_found() {
    let template = template();
    for (scale, angle, shift) in [
        (1.0, 0.0, [0.0, 0.0]),
        (1.1, 0.15, [0.02, -0.015]),
        (0.92, -0.15, [-0.02, 0.015]),
    ] {
        let truth = PlanarSimilarity::new(scale, angle, DVec2::from_array(shift));
        let target = moved(&truth, |_, seen| seen);
        let start = PlanarSimilarity::new(1.0, 0.0, DVec2::ZERO);
        let found = aligned(&template, &target, &[start]).expect("it is in view");
        let [by_scale, by_angle, by_shift] = apart(&found.motion, &truth);
        assert!(by_scale < 0.01 && by_angle < 0.01, "{found:?}");
        assert!(by_shift < 0.002, "{found:?}");
        assert!(
            found.agreement > 0.8 && found.uncertainty < 0.01,
            "{found:?}"
        );
    }
}

/// Checks that neither what the mask leaves out nor a foreign thing inside of the mask shrinks an object.
#[test]
fn a_thing_that_hides_forty_percent_does_not_shrink_it() {
    let template = template();
    let truth = PlanarSimilarity::new(1.04, 0.08, DVec2::new(0.02, 0.01));
    // A strip of 40 % of a disc's area: |x| < 0.32 of its radius.
    let is_hidden = |own: DVec2| own.x.abs() < 0.32 * 0.25;
    let cut_out = moved(
        &truth,
        |own, seen| {
            if is_hidden(own) { [0.2, 0.0] } else { seen }
        },
    );
    let painted = moved(&truth, |own, seen| {
        if is_hidden(own) {
            [0.95, seen[1]]
        } else {
            seen
        }
    });
    let start = PlanarSimilarity::new(1.0, 0.0, DVec2::ZERO);
    for target in [cut_out, painted] {
        let found = aligned(&template, &target, &[start]).expect("it is in view");
        let [by_scale, by_angle, _] = apart(&found.motion, &truth);
        assert!(by_scale < 0.03, "{found:?}");
        assert!(by_angle < 5_f64.to_radians(), "{found:?}");
    }
}

#[test]
fn a_flat_thing_is_not_tracked() {
    let flat = patch(|at| [0.5, disc(at)]);
    let template = Template::pyramid(&flat, DVec2::ZERO);
    let start = PlanarSimilarity::new(1.0, 0.0, DVec2::ZERO);
    let found = aligned(&template, &flat, &[start]);
    assert!(
        found.is_none_or(|found| found.uncertainty > 0.5),
        "{found:?}"
    );
}
