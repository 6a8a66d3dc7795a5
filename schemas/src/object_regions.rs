//! Regions of a frame: moving content, and the objects of a class.
//!
//! A frame's own mask of a region comes first. Where it has none, the region is the union of the scene's objects, those
//! of the class or all, since objects move. An object without a mask in a frame is as large as its box there.

use std::collections::BTreeMap;

use crate::{
    camera::Camera,
    mask::Mask,
    records::{ObjectClass, Scene, SceneFrame},
};

/// A region of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Region<'a> {
    /// Moving content.
    Moving,
    /// The objects of a class, by the name of its masks: `human`, `vehicle`.
    Class(&'a str),
}

/// Shape of an object in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ObjectShape<'a> {
    /// Its mask, a file of the scene.
    Mask(&'a str),
    /// Its box: left, top, width and height in pixels of the scene's images.
    Box([f64; 4]),
}

/// Source of a region in a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum RegionSource<'a> {
    /// A mask of the region, a file of the scene.
    Mask(&'a str),
    /// Objects, whose union it is, by their names. Without any the region is empty.
    Objects(BTreeMap<&'a str, ObjectShape<'a>>),
}

impl Region<'_> {
    /// Returns the source of the region in a frame of a scene; `None` where nothing tells it.
    pub fn source<'s>(self, scene: &'s Scene, frame: &'s SceneFrame) -> Option<RegionSource<'s>> {
        let own = match self {
            Self::Moving => frame.mask.as_ref(),
            Self::Class(class) => frame.classes.get(class),
        };
        if let Some(file) = own {
            return Some(RegionSource::Mask(file));
        }
        self.is_of_objects(scene).then(|| {
            let shapes = shapes(frame).into_iter();
            let of_region = shapes.filter(|(name, _)| self.has(scene.class_of(name)));
            RegionSource::Objects(of_region.collect())
        })
    }

    /// Returns true if the scene has any object that is part of the region.
    fn is_of_objects(self, scene: &Scene) -> bool {
        let mut listed = scene.objects.values();
        if listed.any(|object| self.has(object.class)) {
            return true;
        }
        let frames = scene.frames.iter();
        let mut names = frames.flat_map(|frame| frame.objects.keys().chain(frame.boxes.keys()));
        names.any(|name| self.has(scene.class_of(name)))
    }

    /// Returns true if objects of this class are part of the region.
    fn has(self, class: ObjectClass) -> bool {
        match self {
            Self::Moving => true,
            Self::Class(name) => class.region() == Some(name),
        }
    }
}

/// Returns the shapes of the objects in a frame, by their names.
pub fn shapes(frame: &SceneFrame) -> BTreeMap<&str, ObjectShape<'_>> {
    let boxes = frame.boxes.iter();
    let boxes = boxes.map(|(name, &sides)| (name.as_str(), ObjectShape::Box(sides)));
    let masks = frame.objects.iter();
    let masks = masks.map(|(name, file)| (name.as_str(), ObjectShape::Mask(file)));
    // Masks replace boxes.
    boxes.chain(masks).collect()
}

impl ObjectShape<'_> {
    /// Returns the mask of the object at a size (width, height); `camera` is that of the scene. Files are read by
    /// `read`.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn mask<E>(
        self,
        camera: &Camera,
        [width, height]: [usize; 2],
        read: impl FnOnce(&str) -> Result<Mask, E>,
    ) -> Result<Mask, E> {
        let mask = match self {
            Self::Mask(file) => read(file)?,
            Self::Box(sides) => box_mask(camera, sides),
        };
        Ok(mask.resized_to_nearest(width, height))
    }
}

impl<'a> RegionSource<'a> {
    /// Returns the files of the scene that it is made of.
    pub fn files(&self) -> Vec<&'a str> {
        match self {
            Self::Mask(file) => vec![*file],
            Self::Objects(objects) => {
                let shapes = objects.values();
                let files = shapes.filter_map(|shape| match shape {
                    ObjectShape::Mask(file) => Some(*file),
                    ObjectShape::Box(_) => None,
                });
                files.collect()
            }
        }
    }

    /// Returns the mask of the region at a size (width, height); `camera` is that of the scene. Files are read by
    /// `read`.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn mask<E>(
        &self,
        camera: &Camera,
        size: [usize; 2],
        mut read: impl FnMut(&str) -> Result<Mask, E>,
    ) -> Result<Mask, E> {
        match self {
            Self::Mask(file) => ObjectShape::Mask(file).mask(camera, size, read),
            Self::Objects(objects) => {
                let mut union = empty(size);
                for shape in objects.values() {
                    union = union.united(&shape.mask(camera, size, &mut read)?);
                }
                Ok(union)
            }
        }
    }
}

fn empty([width, height]: [usize; 2]) -> Mask {
    Mask::new(width, height, vec![0; width * height])
}

/// Marks the pixels of the scene's images whose centres are in a box.
fn box_mask(camera: &Camera, [left, top, width, height]: [f64; 4]) -> Mask {
    let mut mask = empty(camera.size());
    let columns = mask.width;
    let turn = match camera {
        Camera::Erp(_) => columns as f64,
        Camera::Pinhole(_) => f64::INFINITY,
    };
    let is_within = |place: f64, first: f64, side: f64| first <= place && place < first + side;
    for (pixel, value) in mask.data.iter_mut().enumerate() {
        let x = (pixel % columns) as f64 + 0.5;
        let y = (pixel / columns) as f64 + 0.5;
        let is_in_columns = is_within(x, left, width) || is_within(x + turn, left, width);
        if is_in_columns && is_within(y, top, height) {
            *value = u8::MAX;
        }
    }
    mask
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use std::convert::Infallible;

    use super::*;
    use crate::{
        camera::{ErpCamera, PinholeCamera},
        records::SceneObject,
    };

    const SIZE: [usize; 2] = [8, 4];

    fn frame() -> SceneFrame {
        SceneFrame::new("frames/0.png".to_owned(), 0.0, None)
    }

    /// Returns a scene of a car, a walker and a dog without a class. The second frame shows none of them.
    fn scene() -> Scene {
        let listed = |class| SceneObject { class };
        let seen = SceneFrame {
            objects: [("car", "car.png"), ("walker", "walker.png")]
                .map(|(name, file)| (name.to_owned(), file.to_owned()))
                .into(),
            boxes: [
                ("car".to_owned(), [0.0, 0.0, 8.0, 4.0]),
                ("dog".to_owned(), [6.0, 3.0, 2.0, 1.0]),
            ]
            .into(),
            ..frame()
        };
        Scene {
            objects: [
                ("car".to_owned(), listed(ObjectClass::Vehicle)),
                ("walker".to_owned(), listed(ObjectClass::Person)),
            ]
            .into(),
            ..Scene::given(
                "street/seq-000",
                PinholeCamera::new([8, 4], [8.0, 8.0], [4.0, 2.0]),
                vec![seen, frame()],
            )
        }
    }

    /// Reads masks of the first row: the car has columns 0 to 3, the walker 2 to 5.
    fn read(file: &str) -> Result<Mask, Infallible> {
        let columns = match file {
            "car.png" => 0..4,
            _ => 2..6,
        };
        let mut mask = empty(SIZE);
        mask.data[columns].fill(255);
        Ok(mask)
    }

    fn marked(scene: &Scene, frame: usize, region: Region<'_>) -> Option<Vec<usize>> {
        let source = region.source(scene, &scene.frames[frame])?;
        let mask = source.mask(&scene.camera, SIZE, read).unwrap();
        let pixels = mask.data.iter().enumerate();
        Some(
            pixels
                .filter(|(_, value)| **value != 0)
                .map(|(at, _)| at)
                .collect(),
        )
    }

    #[test]
    fn what_moves_is_the_union_of_the_objects() {
        let scene = scene();
        // Car and walker share two pixels; the dog has a box alone, whose pixels are the last two.
        let moving = marked(&scene, 0, Region::Moving);
        assert_eq!(moving, Some(vec![0, 1, 2, 3, 4, 5, 30, 31]));
        let vehicles = marked(&scene, 0, Region::Class("vehicle"));
        assert_eq!(vehicles, Some(vec![0, 1, 2, 3]));
        let people = marked(&scene, 0, Region::Class("human"));
        assert_eq!(people, Some(vec![2, 3, 4, 5]));
        assert_eq!(marked(&scene, 0, Region::Class("sky")), None);
        for region in [Region::Moving, Region::Class("vehicle")] {
            assert_eq!(marked(&scene, 1, region), Some(Vec::new()));
        }
        let names: Vec<&str> = scene.object_names().into_iter().collect();
        assert_eq!(names, ["car", "dog", "walker"]);
        assert_eq!(scene.class_of("dog"), ObjectClass::Other);
    }

    #[test]
    fn masks_of_a_region_come_before_objects() {
        let mut scene = scene();
        scene.frames[0].mask = Some("walker.png".to_owned());
        scene.frames[1].classes = [("human".to_owned(), "car.png".to_owned())].into();
        assert_eq!(marked(&scene, 0, Region::Moving), Some(vec![2, 3, 4, 5]));
        let people = marked(&scene, 1, Region::Class("human"));
        assert_eq!(people, Some(vec![0, 1, 2, 3]));
        let source = Region::Moving.source(&scene, &scene.frames[0]);
        assert_eq!(source.unwrap().files(), ["walker.png"]);
        scene.objects.clear();
        scene.frames.truncate(1);
        scene.frames[0] = frame();
        assert_eq!(marked(&scene, 0, Region::Moving), None);
    }

    #[test]
    fn boxes_go_on_at_the_left_edge_of_panoramas_alone() {
        let erp = Camera::Erp(ErpCamera::new(8, 4));
        let row = |camera: &Camera| box_mask(camera, [6.5, 1.0, 3.0, 1.0]).data[8..16].to_vec();
        assert_eq!(row(&erp), [255, 0, 0, 0, 0, 0, 255, 255]);
        assert_eq!(row(&scene().camera), [0, 0, 0, 0, 0, 0, 255, 255]);
        assert!(!box_mask(&erp, [f64::NAN, 0.0, 4.0, 4.0]).marks_anything());
    }

    #[test]
    fn boxes_are_in_pixels_of_the_images_of_the_scene() {
        let shape = ObjectShape::Box([4.0, 0.0, 4.0, 2.0]);
        let mask = shape.mask(&scene().camera, [4, 2], read).unwrap();
        assert_eq!(mask.data, [0, 0, 255, 255, 0, 0, 0, 0]);
    }

    #[test]
    fn records_without_objects_are_read() {
        let mut scene = scene();
        scene.objects.clear();
        scene.frames[0] = frame();
        let text = serde_json::to_value(&scene).unwrap();
        assert!(text.get("objects").is_none() && text["frames"][0].get("boxes").is_none());
        assert_eq!(serde_json::from_value::<Scene>(text).unwrap(), scene);
    }
}
