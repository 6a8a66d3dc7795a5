//! Round trips of the camera models, at the seam and the poles above all.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, dvec2, dvec3};
use omnilife_schemas::camera::{CameraModel, ErpCamera, PinholeCamera};
use proptest::prelude::*;

const TOLERANCE_PIXELS: f64 = 1e-9;

fn erp_cameras() -> impl Strategy<Value = ErpCamera> {
    (1_u32..=4096, 1_u32..=4096).prop_map(|(width, height)| ErpCamera { width, height })
}

/// Returns shares of an image side, with the neighbourhood of both ends as likely as the inside.
fn shares() -> impl Strategy<Value = f64> {
    prop_oneof![
        0.0..1.0,
        (-12.0..-1.0).prop_map(|exponent: f64| 10.0_f64.powf(exponent)),
        (-12.0..-1.0).prop_map(|exponent: f64| 1.0 - 10.0_f64.powf(exponent)),
    ]
}

fn directions() -> impl Strategy<Value = DVec3> {
    let part = || prop_oneof![-1.0..1.0, (-9.0..0.0).prop_map(|e: f64| 10.0_f64.powf(e))];
    (part(), part(), part(), -100.0..100.0)
        .prop_filter("not the zero vector", |&(x, y, z, _)| {
            dvec3(x, y, z).length() > 1e-8
        })
        .prop_map(|(x, y, z, exponent)| dvec3(x, y, z) * 10.0_f64.powf(exponent))
}

proptest! {
    #[test]
    fn erp_pixels_come_back(camera in erp_cameras(), a in shares(), b in shares()) {
        let pixel = dvec2(a * f64::from(camera.width), b * f64::from(camera.height));
        let back = camera.project(camera.unproject(pixel));
        prop_assert!(back.is_some());
        let back = back.unwrap_or_default();
        prop_assert!(camera.wrapped_column_distance(pixel.x, back.x).abs() < TOLERANCE_PIXELS);
        prop_assert!((pixel.y - back.y).abs() < TOLERANCE_PIXELS);
    }

    #[test]
    fn erp_pixels_a_whole_turn_away_are_the_same(
        camera in erp_cameras(), a in shares(), b in shares(), turns in -3_i32..=3
    ) {
        let pixel = dvec2(a * f64::from(camera.width), b * f64::from(camera.height));
        let turned = pixel + dvec2(f64::from(turns) * f64::from(camera.width), 0.0);
        prop_assert!(camera.unproject(pixel).distance(camera.unproject(turned)) < 1e-14);
    }

    #[test]
    fn erp_directions_come_back(camera in erp_cameras(), direction in directions()) {
        let pixel = camera.project(direction);
        prop_assert!(pixel.is_some());
        let pixel = pixel.unwrap_or_default();
        prop_assert!((0.0..f64::from(camera.width)).contains(&pixel.x), "u = {}", pixel.x);
        prop_assert!((0.0..=f64::from(camera.height)).contains(&pixel.y), "v = {}", pixel.y);
        prop_assert!(camera.unproject(pixel).distance(direction.normalize()) < 1e-14);
    }

    #[test]
    fn erp_follows_the_formulas(camera in erp_cameras(), direction in directions()) {
        let unit = direction.normalize();
        // The arc sine loses digits at the poles; this test stays 1e-3 rad away from them.
        prop_assume!(unit.y.abs() < 1.0 - 1e-6);
        let u = (unit.x.atan2(unit.z) / TAU + 0.5) * f64::from(camera.width);
        let v = (0.5 - (-unit.y).asin() / PI) * f64::from(camera.height);
        let pixel = camera.project(direction).unwrap_or_default();
        prop_assert!(camera.wrapped_column_distance(pixel.x, u).abs() < TOLERANCE_PIXELS);
        prop_assert!((pixel.y - v).abs() < TOLERANCE_PIXELS);
    }

    #[test]
    fn wrapped_distances_are_the_short_way_round(
        camera in erp_cameras(), from in -3.0..3.0, to in -3.0..3.0
    ) {
        let width = f64::from(camera.width);
        let distance = camera.wrapped_column_distance(from * width, to * width);
        prop_assert!(distance.abs() <= 0.5 * width * (1.0 + 1e-15));
        let turns: f64 = (from * width + distance - to * width) / width;
        prop_assert!((turns - turns.round()).abs() < 1e-12);
    }

    #[test]
    fn pinhole_pixels_come_back(
        width in 1_u32..=4096, height in 1_u32..=4096,
        field_of_view in 0.1..2.8, a in 0.0..1.0, b in 0.0..1.0, depth in -6.0..6.0
    ) {
        let camera = PinholeCamera::with_horizontal_field_of_view(width, height, field_of_view);
        let pixel = dvec2(a * f64::from(width), b * f64::from(height));
        let point = camera.unproject(pixel) * 10.0_f64.powf(depth);
        let back = camera.project(point);
        prop_assert!(back.is_some());
        // Tall images under a narrow width reach far off the axis, where pixels per radian grow.
        let slope = 1.0 + ((pixel - dvec2(camera.cx, camera.cy)) / camera.fx).length_squared();
        prop_assert!(back.unwrap_or_default().distance(pixel) < TOLERANCE_PIXELS * slope.min(1e3));
    }

    #[test]
    fn pinhole_sees_nothing_behind(x in -10.0..10.0, y in -10.0..10.0, z in -10.0..=0.0) {
        let camera = PinholeCamera::with_horizontal_field_of_view(640, 480, 1.2);
        prop_assert_eq!(camera.project(dvec3(x, y, z)), None);
    }
}

#[test]
fn erp_axes_are_where_the_convention_says() {
    let camera = ErpCamera::new(1024, 512);
    for (direction, pixel) in [
        (DVec3::Z, dvec2(512.0, 256.0)),
        (DVec3::X, dvec2(768.0, 256.0)),
        (DVec3::NEG_X, dvec2(256.0, 256.0)),
        (DVec3::NEG_Z, dvec2(0.0, 256.0)),
        // y points down, so the top row looks along -y.
        (dvec3(0.0, -1.0, 1.0), dvec2(512.0, 128.0)),
        (dvec3(0.0, 1.0, 1.0), dvec2(512.0, 384.0)),
    ] {
        assert_eq!(camera.project(direction), Some(pixel), "{direction}");
    }
}

#[test]
fn erp_seam_columns_meet() {
    let camera = ErpCamera::new(1000, 500);
    // Either sign of zero stands for the seam; both give column 0, never column W.
    for x in [0.0, -0.0] {
        let pixel = camera.project(dvec3(x, 0.0, -1.0)).unwrap_or(DVec2::NAN);
        assert_eq!(pixel.x, 0.0);
    }
    let left = camera.unproject(dvec2(0.5, 100.0));
    let right = camera.unproject(dvec2(999.5, 100.0));
    assert_eq!(camera.wrapped_column_distance(999.5, 0.5), 1.0);
    assert_eq!(camera.wrapped_column_distance(0.5, 999.5), -1.0);
    // One pixel of longitude, TAU / 1000, on the circle of latitude 54 degrees.
    let latitude: f64 = (0.5 - 100.0 / 500.0) * PI;
    let chord = 2.0 * (PI / 1000.0).sin() * latitude.cos();
    assert!((left.distance(right) - chord).abs() < 1e-15);
}

#[test]
fn erp_poles_have_a_row_and_some_column() {
    let camera = ErpCamera::new(1024, 512);
    for (y, v) in [(-1.0, 0.0), (1.0, 512.0)] {
        for (x, z) in [(0.0, 0.0), (-0.0, 0.0), (0.0, -0.0), (-0.0, -0.0)] {
            let pixel = camera.project(dvec3(x, y, z)).unwrap_or(DVec2::NAN);
            assert_eq!(pixel.y, v);
            assert!((0.0..1024.0).contains(&pixel.x), "u = {}", pixel.x);
        }
        for column in [0.0, 300.0, 1024.0] {
            let direction = camera.unproject(dvec2(column, v));
            assert!(direction.distance(dvec3(0.0, y, 0.0)) < 1e-15);
        }
    }
}

#[test]
fn erp_refuses_what_has_no_direction() {
    let camera = ErpCamera::new(8, 4);
    for point in [
        DVec3::ZERO,
        DVec3::NAN,
        dvec3(f64::INFINITY, 0.0, 1.0),
        dvec3(0.0, f64::NAN, 1.0),
    ] {
        assert_eq!(camera.project(point), None, "{point}");
    }
}

#[test]
fn erp_pixels_cover_the_sphere() {
    let camera = ErpCamera::new(512, 256);
    let rows = (0..camera.height).map(|row| camera.pixel_solid_angle(row));
    let sphere = rows.sum::<f64>() * f64::from(camera.width);
    // The midpoint rule's error for 256 rows: pi^2 / (24 * 256^2) = 6.3e-6 of the whole.
    assert!((sphere / (4.0 * PI) - 1.0).abs() < 1e-5, "{sphere}");
}

#[test]
fn pinhole_corners_span_the_field_of_view() {
    let camera = PinholeCamera::with_horizontal_field_of_view(640, 480, PI / 2.0);
    let left = camera.unproject(dvec2(0.0, 240.0));
    let right = camera.unproject(dvec2(640.0, 240.0));
    assert!((left.angle_between(right) - PI / 2.0).abs() < 1e-12);
    assert_eq!(camera.project(DVec3::Z), Some(dvec2(320.0, 240.0)));
    assert_eq!(camera.project(dvec3(1e300, 0.0, 1e-300)), None);
    assert_eq!(camera.project(DVec3::NAN), None);
}
