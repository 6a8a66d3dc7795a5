//! Objects of a trained object graph: edits of vehicles by a script.

use std::path::Path;

use glam::{DMat3, DVec3};
use omnilife_engine::{gaussians::tracked::OBJECT_NUMBERS, parameters::ParameterTable};
use omnilife_schemas::{
    records::{GraphObject, InvalidGaussians, Objects, Poses, RunRecord},
    store,
    trajectory::{GroundAxes, ObjectPath},
};

use super::{
    EditPurpose, EditedModel, Export, ModelFormat, PlannedFiles, gaussians, run_views,
    script::{self, Axes, Edit, Script, Unit},
};
use crate::{
    error::ReconstructError,
    formats::{
        GAUSSIANS_FILE, MOVING_GAUSSIANS_FILE, OBJECT_GAUSSIANS_FILE, OBJECTS_FILE,
        REFINED_POSES_FILE, objects, validity,
    },
};

/// Model format of Gaussians of a static world and of its moving objects.
pub const OBJECT_GRAPH: ModelFormat = ModelFormat {
    files: &[
        GAUSSIANS_FILE,
        MOVING_GAUSSIANS_FILE,
        OBJECTS_FILE,
        OBJECT_GAUSSIANS_FILE,
        REFINED_POSES_FILE,
    ],
    open: gaussians::open,
    edit: Some(edit),
    exports: &[Export::Splats],
};

/// Applies edits to the objects of a run and checks the outcome.
///
/// # Errors
/// When the run has no objects, an edit does not suit them, or it moves an object to a time outside of the run's
/// views.
fn edit<'a>(
    folder: &'a Path,
    run: &RunRecord,
    script: &Script,
    _: EditPurpose,
) -> Result<EditedModel<'a>, ReconstructError> {
    if !folder.join(OBJECTS_FILE).is_file() {
        let reason = format!("must have objects to edit, and {OBJECTS_FILE} is missing");
        return Err(ReconstructError::scene(folder, reason));
    }
    let mut invalid = InvalidGaussians::default();
    let (record, table) = objects::read_parts(folder, &mut invalid)?;
    let mut graph = EditedObjects {
        record,
        table,
        clip_seconds: run.clip_seconds,
        views: run.views.as_ref(),
    };
    let changes = script.apply(|edit| graph.apply(edit))?;
    let mut warnings = validity::notes(folder, &invalid);
    warnings.extend(graph.out_of_view());
    let EditedObjects { record, table, .. } = graph;
    let others = [GAUSSIANS_FILE, MOVING_GAUSSIANS_FILE];
    let others: Vec<&str> = (others.into_iter())
        .filter(|file| folder.join(file).is_file())
        .collect();
    let files = [OBJECTS_FILE, OBJECT_GAUSSIANS_FILE].into_iter();
    let files: Vec<String> = files
        .chain(others.iter().copied())
        .map(str::to_owned)
        .collect();
    let write = move |out: &Path| {
        for file in others {
            store::copy_atomically(&folder.join(file), &out.join(file))?;
        }
        objects::write_table(out, &table)?;
        Ok(store::write_record(&out.join(OBJECTS_FILE), &record)?)
    };
    Ok(EditedModel {
        planned: PlannedFiles {
            files,
            write: Box::new(write),
        },
        changes,
        warnings,
    })
}

/// Objects and their Gaussians, with the run's views; runs of older versions lack their times and poses.
struct EditedObjects<'a> {
    record: Objects,
    table: ParameterTable,
    clip_seconds: Option<[f64; 2]>,
    views: Option<&'a Poses>,
}

impl EditedObjects<'_> {
    /// Applies an edit; returns its description.
    fn apply(&mut self, edit: &Edit) -> Result<String, String> {
        let id = edit.object();
        let at = self.position(id)?;
        let done = match edit {
            Edit::Remove { .. } => {
                self.remove(at);
                format!("remove {id}")
            }
            Edit::Shift { by, unit, axes, .. } => {
                let length = match unit.unwrap_or(Unit::World) {
                    Unit::World => 1.0,
                    Unit::Distance => self.distance(at)?,
                };
                let offset = length * (self.axes(*axes)? * DVec3::from_array(*by));
                self.change(at, |path| path.shifted(offset));
                format!("shift {id} by {offset}")
            }
            Edit::Rotate { turn, axes, .. } => {
                let up = DVec3::from_array(self.record.up);
                let turn = self.axes(*axes)? * DVec3::from_array(*turn);
                let degrees = turn.dot(up);
                if (turn - degrees * up).length() > 1e-6 * turn.length() {
                    return Err(
                        "vehicles turn about up alone: axes = \"ground\", turn = [0, 0, degrees]"
                            .to_owned(),
                    );
                }
                self.change(at, |path| path.turned(degrees.to_radians()));
                format!("rotate {id} by {degrees} degrees in its place; its path stays")
            }
            Edit::Duplicate { new, .. } => {
                let copy = self.duplicate(at, new.as_deref())?;
                format!("duplicate {id} as {copy}")
            }
            Edit::Retime {
                seconds, frames, ..
            } => {
                let seconds = script::delay(*seconds, *frames)?.seconds(self.views)?;
                self.change(at, |path| path.delayed(seconds));
                self.stays_in_clip(at)?;
                format!("retime {id} by {} s", (1e6 * seconds).round() / 1e6)
            }
            Edit::Texture { .. } => {
                return Err(
                    "vehicles are made of Gaussians and have no texture to paint".to_owned(),
                );
            }
            Edit::Insert { .. } => {
                return Err("insert must go into an atlas, got a graph of vehicles".to_owned());
            }
        };
        match self
            .record
            .objects
            .iter()
            .find_map(|object| object.path.fault())
        {
            Some(fault) => Err(format!("{done}: its path {fault}")),
            None => Ok(done),
        }
    }

    fn position(&self, id: &str) -> Result<usize, String> {
        let objects = &self.record.objects;
        let number = id.parse::<u32>().ok();
        let at = number.and_then(|id| objects.iter().position(|object| object.id == id));
        at.ok_or_else(|| {
            let known: Vec<String> = objects.iter().map(|object| object.id.to_string()).collect();
            format!("the object must be one of {}, got {id:?}", known.join(", "))
        })
    }

    /// Returns the axes of displacements as columns in the world.
    fn axes(&self, axes: Option<Axes>) -> Result<DMat3, String> {
        match axes.unwrap_or(Axes::Ground) {
            Axes::World => Ok(DMat3::IDENTITY),
            Axes::Ground => Ok(GroundAxes::new(DVec3::from_array(self.record.up)).to_world),
            Axes::Camera => {
                let first = self.views.and_then(|views| views.frames.first());
                let rotation = first.and_then(|first| first.pose.rotation());
                let rotation =
                    rotation.ok_or("the run's record has no views: camera axes are unknown")?;
                Ok(DMat3::from_quat(rotation))
            }
        }
    }

    /// Returns the distance of an object's middle from the first view's camera, world units.
    fn distance(&self, at: usize) -> Result<f64, String> {
        let first = self.views.and_then(|views| views.frames.first());
        let first =
            first.ok_or("the run's record has no views: distances from the camera are unknown")?;
        let centre = &self.record.objects[at].path.centre;
        let [begin, end] = centre.range();
        Ok(centre
            .position(0.5 * (begin + end))
            .distance(first.pose.centre()))
    }

    fn remove(&mut self, at: usize) {
        let numbers = self.table.position(OBJECT_NUMBERS).unwrap_or_default();
        let of_rows = self.table.arrays[numbers].values.iter();
        let keep: Vec<bool> = of_rows.map(|&number| number as usize != at).collect();
        self.table.retain(&keep);
        for number in &mut self.table.arrays[numbers].values {
            if *number as usize > at {
                *number -= 1.0;
            }
        }
        self.record.objects.remove(at);
    }

    fn change(&mut self, at: usize, change: impl FnOnce(ObjectPath) -> ObjectPath) {
        let object = &mut self.record.objects[at];
        object.path = change(object.path.clone());
    }

    /// Appends a copy; returns its id.
    fn duplicate(&mut self, at: usize, new: Option<&str>) -> Result<u32, String> {
        let objects = &mut self.record.objects;
        let largest = objects.iter().map(|object| object.id).max().unwrap_or(0);
        let id = match new {
            None => largest.checked_add(1),
            Some(new) => new.parse().ok(),
        };
        let id = id
            .filter(|id| objects.iter().all(|object| object.id != *id))
            .ok_or_else(|| {
                format!(
                    "new must be a free number of an object, got {:?}",
                    new.unwrap_or("none")
                )
            })?;
        let copied = GraphObject {
            id,
            ..objects[at].clone()
        };
        let number = objects.len() as f32;
        objects.push(copied);
        let numbers = self.table.position(OBJECT_NUMBERS).unwrap_or_default();
        let rows: Vec<usize> = (0..self.table.len())
            .filter(|&row| self.table.row(numbers, row)[0] as usize == at)
            .collect();
        let first = self.table.len();
        self.table.append_copies(&rows);
        self.table.arrays[numbers].values[first..].fill(number);
        Ok(id)
    }

    /// Refuses to move an object to a time outside of the run's views.
    fn stays_in_clip(&self, at: usize) -> Result<(), String> {
        let Some([first, last]) = self.clip_seconds else {
            return Ok(());
        };
        let object = &self.record.objects[at];
        let [begin, end] = object.path.centre.range();
        if end < first || begin > last {
            return Err(format!(
                "object {} is never in view then: it is there from {begin} to {end} s, the views are from {first} to \
                 {last} s",
                object.id
            ));
        }
        Ok(())
    }

    /// Returns a line for each edited object that is outside of all views of the run; other cameras may see it.
    fn out_of_view(&self) -> Vec<String> {
        let Some(views) = self.views else {
            return Vec::new();
        };
        let objects = self.record.objects.iter();
        objects
            .filter(|object| !run_views::is_in_view(object, self.record.up, views))
            .map(|object| {
                format!(
                    "object {} is out of every one of the run's {} views now",
                    object.id,
                    views.frames.len()
                )
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use omnilife_schemas::{
        Pose,
        camera::PinholeCamera,
        records::{PosedFrame, Scale},
        trajectory::{BSpline, ObjectPath},
    };

    use super::*;

    fn record() -> Objects {
        let centre = BSpline {
            degree: 1,
            knots: BSpline::uniform_knots(1, 2, 2.0, 6.0),
            coefficients: vec![[0.0; 3], [4.0, 0.0, 0.0]],
        };
        Objects {
            up: [0.0, 0.0, 1.0],
            objects: vec![GraphObject {
                id: 3,
                dimensions: [4.5, 1.8, 1.5],
                path: ObjectPath {
                    centre,
                    heading_seconds: vec![2.0],
                    headings: vec![0.0],
                },
                corrections: vec![[0.0; 4]],
            }],
        }
    }

    fn edited<'a>(views: Option<&'a Poses>, clip_seconds: Option<[f64; 2]>) -> EditedObjects<'a> {
        EditedObjects {
            record: record(),
            table: ParameterTable::default(),
            clip_seconds,
            views,
        }
    }

    fn shift(by: [f64; 3]) -> Edit {
        Edit::Shift {
            object: "3".to_owned(),
            by,
            unit: None,
            axes: None,
        }
    }

    fn retime(seconds: f64) -> Edit {
        Edit::Retime {
            object: "3".to_owned(),
            seconds: Some(seconds),
            frames: None,
        }
    }

    #[test]
    fn an_edit_that_objects_cannot_have_changes_nothing() {
        let of = |object: &str| Edit::Remove {
            object: object.to_owned(),
        };
        let texture = Edit::Texture {
            object: "3".to_owned(),
            image: "painted.png".into(),
            frame: None,
        };
        let turn = Edit::Rotate {
            object: "3".to_owned(),
            turn: [10.0, 0.0, 0.0],
            axes: None,
        };
        let taken = Edit::Duplicate {
            object: "3".to_owned(),
            new: Some("3".to_owned()),
        };
        for edit in [of("4"), of("swan"), texture, turn, taken] {
            let mut graph = edited(None, None);
            assert!(graph.apply(&edit).is_err(), "{edit:?}");
            assert_eq!(graph.record, record());
        }
    }

    #[test]
    fn an_object_that_is_sent_out_of_the_clip_is_never_in_view() {
        let delayed = |seconds: f64, clip: Option<[f64; 2]>| {
            edited(None, clip).apply(&retime(seconds)).map(|_| ())
        };
        let clip = Some([0.0, 10.0]);
        for seconds in [0.0, 7.9, -5.9] {
            assert_eq!(delayed(seconds, clip), Ok(()));
        }
        for seconds in [8.1, -6.1, 1e9] {
            let refusal = delayed(seconds, clip);
            assert!(
                refusal.is_err_and(|reason| reason.contains("object 3 is never in view")),
                "{seconds}"
            );
        }
        assert_eq!(delayed(1e9, None), Ok(()));
    }

    #[test]
    fn axes_and_units_are_those_of_the_first_view_where_they_are_named() {
        let views = views();
        let moved = |axes: Axes, unit: Unit| {
            let mut graph = edited(Some(&views), None);
            let edit = Edit::Shift {
                object: "3".to_owned(),
                by: [0.0, 0.0, 0.5],
                unit: Some(unit),
                axes: Some(axes),
            };
            graph.apply(&edit).expect("moved");
            let centre = |record: &Objects| record.objects[0].path.centre.position(4.0);
            centre(&graph.record) - centre(&record())
        };
        let up = moved(Axes::Ground, Unit::World);
        assert!(up.distance(0.5 * DVec3::Z) < 1e-12, "{up}");
        let forward = moved(Axes::Camera, Unit::Distance);
        let expected = -0.5 * DVec3::new(2.0, 0.0, 40.0).length() * DVec3::Z;
        assert!(forward.distance(expected) < 1e-9, "{forward}");
        assert!(edited(None, None).axes(Some(Axes::Camera)).is_err());
    }

    /// Returns one view from 40 m straight down.
    fn views() -> Poses {
        let looks_down = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
        let pose = Pose::new(DQuat::from_mat3(&looks_down), DVec3::Z * 40.0);
        Poses::new(
            Scale::Metres,
            Some(PinholeCamera::with_horizontal_field_of_view(64, 36, 1.1).into()),
            vec![PosedFrame::new(3.0, pose)],
        )
    }

    #[test]
    fn an_object_that_is_moved_out_of_every_view_is_told() {
        let views = views();
        let told = |east: f64, views: Option<&Poses>| {
            let mut graph = edited(views, None);
            graph.apply(&shift([east, 0.0, 0.0])).expect("moved");
            graph.out_of_view().len()
        };
        assert_eq!(told(5.0, Some(&views)), 0);
        assert_eq!(told(5000.0, Some(&views)), 1);
        assert_eq!(told(5000.0, None), 0);
    }
}
