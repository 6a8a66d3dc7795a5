//! Labelled boxes.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use omnilife_schemas::{oriented_box::OrientedBox, records::ObjectClass};

use super::Segment;
use crate::{error::CurateError, exchange::driving::objects::LabelledObject};

/// Class of the people and the riders with their cycles: the box of a rider holds both.
const PEOPLE: [i64; 2] = [2, 4];
const VEHICLE: i64 = 1;

/// Reads the labelled objects, with ids in the order of their first boxes.
///
/// # Errors
/// When a row is damaged, is of no frame, or is the second one of an object in a frame.
pub(super) fn read(
    segment: &Segment<'_>,
    notes: &mut Vec<String>,
) -> Result<Vec<LabelledObject>, CurateError> {
    let Some(table) = segment.table("lidar_box")? else {
        notes.push("no lidar_box: the scene has no moving objects".to_owned());
        return Ok(Vec::new());
    };
    let column = |name: &str| table.column(&format!("[LiDARBoxComponent].{name}"));
    let mut times = table.column("key.frame_timestamp_micros")?;
    let mut names = table.column("key.laser_object_id")?;
    let mut types = column("type")?;
    let mut numbers = [
        "center.x", "center.y", "center.z", "size.x", "size.y", "size.z", "heading",
    ]
    .into_iter()
    .map(|name| column(&format!("box.{name}")))
    .collect::<Result<Vec<_>, _>>()?;
    let mut boxes = BTreeMap::<(i64, String), (i64, OrientedBox)>::new();
    for row in 0..table.rows {
        let (time, name) = (times.integer(row)?, names.text(row)?);
        let (_, vehicle) = segment
            .frame(time)
            .map_err(|reason| table.fault(row, reason))?;
        let values = numbers.iter_mut().map(|column| column.number(row));
        let values = values.collect::<Result<Vec<f64>, _>>()?;
        let one = box_of(&values).ok_or_else(|| {
            table.fault(
                row,
                format!("a box must have sides above 0, got {values:?}"),
            )
        })?;
        let in_world = OrientedBox {
            centre: vehicle.apply(one.centre),
            axes: vehicle.rotation * one.axes,
            half: one.half,
        };
        if boxes
            .insert((time, name.clone()), (types.integer(row)?, in_world))
            .is_some()
        {
            let reason = format!("must be the one box of {name} at {time}");
            return Err(table.fault(row, reason).into());
        }
    }
    let (mut objects, mut ids) = (Vec::<LabelledObject>::new(), BTreeMap::new());
    for ((time, name), (kind, labelled)) in boxes {
        let number = *ids.entry(name.clone()).or_insert(objects.len());
        if objects.get(number).is_none() {
            objects.push(LabelledObject {
                id: u32::try_from(number).unwrap_or(u32::MAX),
                name: Some(name),
                class: class_of(kind),
                boxes: Vec::new(),
            });
        }
        if let Some(object) = objects.get_mut(number) {
            object.boxes.push((segment.seconds(time), labelled));
        }
    }
    Ok(objects)
}

/// Returns a box of its centre, sides (length, width, height) and heading.
fn box_of(values: &[f64]) -> Option<OrientedBox> {
    let &[x, y, z, length, width, height, heading] = values else {
        return None;
    };
    let sides = DVec3::new(length, width, height);
    (sides.min_element() > 0.0).then(|| OrientedBox {
        centre: DVec3::new(x, y, z),
        axes: DMat3::from_rotation_z(heading),
        half: 0.5 * sides,
    })
}

fn class_of(kind: i64) -> ObjectClass {
    match kind {
        VEHICLE => ObjectClass::Vehicle,
        kind if PEOPLE.contains(&kind) => ObjectClass::Person,
        _ => ObjectClass::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_as_long_as_its_first_side_along_its_heading() {
        let quarter = std::f64::consts::FRAC_PI_2;
        let found = box_of(&[1.0, 2.0, 3.0, 4.0, 1.5, 2.0, quarter]);
        let Some(one) = found else {
            panic!("a sound box is read");
        };
        let front = one.centre + one.axes.x_axis * one.half.x;
        assert!(front.distance(DVec3::new(1.0, 4.0, 3.0)) < 1e-12);
        assert!(box_of(&[1.0, 2.0, 3.0, 4.0, 0.0, 2.0, 0.0]).is_none());
        let classes = [0, 1, 2, 3, 4].map(class_of);
        let [vehicle, person, other] = [
            ObjectClass::Vehicle,
            ObjectClass::Person,
            ObjectClass::Other,
        ];
        assert_eq!(classes, [other, vehicle, person, other, person]);
    }
}
