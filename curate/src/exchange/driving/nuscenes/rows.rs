//! Transforms, cameras and boxes of rows.

use glam::{DMat3, DQuat, DVec3};
use omnilife_schemas::{camera::PinholeCamera, oriented_box::OrientedBox, records::ObjectClass};

use super::{
    super::rigid::Rigid,
    tables::{Annotation, CalibratedSensor},
};

/// Place of a pixel's centre in the image, pixels; in the files it is 0.
const PIXEL_CENTRE: f64 = 0.5;

/// Returns the transform of a quaternion (w, x, y, z) and a translation.
///
/// # Errors
/// When the quaternion is not of unit length, or a number is not finite.
pub(super) fn rigid([w, x, y, z]: [f64; 4], translation: [f64; 3]) -> Result<Rigid, String> {
    let rotation = DQuat::from_xyzw(x, y, z, w);
    // NaN compares false, so it is refused too.
    let is_unit = (rotation.length() - 1.0).abs() < 1e-3;
    let transform = is_unit.then(|| {
        Rigid::new(
            DMat3::from_quat(rotation.normalize()),
            DVec3::from_array(translation),
        )
    });
    transform.flatten().ok_or_else(|| {
        format!(
            "rotation must be a unit quaternion w, x, y, z and translation finite, got ({w}, {x}, {y}, {z}) and \
             {translation:?}"
        )
    })
}

pub(super) fn camera_of(
    calibration: &CalibratedSensor,
    [width, height]: [u32; 2],
) -> Result<PinholeCamera, String> {
    let rows: Vec<&[f64]> = (calibration.camera_intrinsic.iter())
        .map(Vec::as_slice)
        .collect();
    let [[fx, skew, cx], [below, fy, cy], [zero, other_zero, one]] = rows.as_slice() else {
        return Err("camera_intrinsic must be a 3x3 matrix".to_owned());
    };
    let is_plain = [*skew, *below, *zero, *other_zero, *one] == [0.0, 0.0, 0.0, 0.0, 1.0];
    let numbers = [*fx, *fy, *cx, *cy];
    let is_sound = is_plain && *fx > 0.0 && *fy > 0.0 && numbers.iter().all(|n| n.is_finite());
    if !is_sound {
        return Err(format!(
            "camera_intrinsic must be [[f, 0, c], [0, f, c], [0, 0, 1]] with f above 0, got {:?}",
            calibration.camera_intrinsic
        ));
    }
    Ok(PinholeCamera {
        width,
        height,
        fx: *fx,
        fy: *fy,
        cx: *cx + PIXEL_CENTRE,
        cy: *cy + PIXEL_CENTRE,
    })
}

/// Returns the box of an annotation in the world.
pub(super) fn box_of(row: &Annotation) -> Result<OrientedBox, String> {
    let place = rigid(row.rotation, row.translation)?;
    let [width, length, height] = row.size;
    let sides = DVec3::new(length, width, height);
    if !sides.is_finite() || sides.min_element() <= 0.0 {
        return Err(format!(
            "size must be a width, length and height above 0, got {:?}",
            row.size
        ));
    }
    Ok(OrientedBox {
        centre: place.translation,
        axes: place.rotation,
        half: 0.5 * sides,
    })
}

pub(super) fn class_of(category: &str) -> ObjectClass {
    match category.split('.').next() {
        Some("vehicle") => ObjectClass::Vehicle,
        Some("human") => ObjectClass::Person,
        _ => ObjectClass::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A quarter turn about z takes x, the front, to y. The second side of a size is the length.
    #[test]
    fn a_box_is_as_long_as_its_second_side_along_its_front() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let mut row = Annotation {
            token: "t".to_owned(),
            sample_token: "a".to_owned(),
            instance_token: "i".to_owned(),
            translation: [3.0, 4.0, 5.0],
            size: [1.5, 4.0, 2.0],
            rotation: [half, 0.0, 0.0, half],
        };
        let found = box_of(&row);
        let Ok(one) = &found else {
            panic!("a sound row is read");
        };
        let front = one.centre + one.axes.x_axis * one.half.x;
        assert!(front.distance(DVec3::new(3.0, 6.0, 5.0)) < 1e-12);
        assert_eq!(one.half.to_array(), [2.0, 0.75, 1.0]);
        row.rotation = [0.0, 0.0, 0.0, 2.0];
        assert!(box_of(&row).is_err());
        row.rotation = [1.0, 0.0, 0.0, 0.0];
        row.size = [1.5, 0.0, 2.0];
        assert!(box_of(&row).is_err());
        assert_eq!(class_of("human.pedestrian.adult"), ObjectClass::Person);
        assert_eq!(class_of("vehicle.bicycle"), ObjectClass::Vehicle);
        assert_eq!(class_of("movable_object.barrier"), ObjectClass::Other);
    }

    #[test]
    fn intrinsics_are_those_of_pixels_with_halves_and_others_are_refused() {
        let calibration = |rows: [[f64; 3]; 3]| CalibratedSensor {
            token: "t".to_owned(),
            sensor_token: "s".to_owned(),
            translation: [0.0; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            camera_intrinsic: rows.iter().map(|row| row.to_vec()).collect(),
        };
        let good = [[50.0, 0.0, 31.5], [0.0, 51.0, 23.5], [0.0, 0.0, 1.0]];
        let expected = PinholeCamera {
            width: 64,
            height: 48,
            fx: 50.0,
            fy: 51.0,
            cx: 32.0,
            cy: 24.0,
        };
        assert_eq!(camera_of(&calibration(good), [64, 48]), Ok(expected));
        for (row, column, value) in [(0, 0, -1.0), (0, 1, 2.0), (2, 2, 0.0), (1, 0, 1.0)] {
            let mut bad = good;
            bad[row][column] = value;
            assert!(
                camera_of(&calibration(bad), [64, 48]).is_err(),
                "{row}, {column}"
            );
        }
        let mut short = calibration(good);
        short.camera_intrinsic.pop();
        assert!(camera_of(&short, [64, 48]).is_err());
    }
}
