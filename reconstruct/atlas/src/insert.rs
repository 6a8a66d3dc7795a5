//! Nodes that edits put into an atlas: RGBA images on a plane, and objects of other runs.
//!
//! A new node takes the place of one that is there: its trajectory with corrections, its times and the height of its
//! plane. The width follows from the proportions of what is inserted.

use std::path::Path;

use glam::DVec2;
use omnilife_engine::surfaces::texture::Texture;

use super::{
    edit::{copied_offsets, read_rgba},
    node::{Fields, Node, Surface},
    outputs, saved,
};

/// Returns a node that shows an RGBA image in the place of another one.
///
/// # Errors
/// When the image cannot be read or is transparent, or the place is a sphere.
pub(super) fn image(place: &Node, id: &str, path: &Path) -> Result<Node, String> {
    let painted = read_rgba(path)?;
    let (width, height) = (painted.width, painted.height);
    // Texels are weighted by their opacity.
    let colours = painted.texels.iter().map(|&[red, green, blue, cover]| {
        let weight = if cover > 0.0 { 1.0 / cover } else { 0.0 };
        [red, green, blue].map(|value| value * weight)
    });
    let node = Node {
        id: id.to_owned(),
        surface: place.surface.clone(),
        colour: Texture {
            width,
            height,
            texels: colours.collect(),
        },
        opacity: Some(Texture {
            width,
            height,
            texels: painted.texels.iter().map(|texel| [texel[3]]).collect(),
        }),
        fields: Fields::default(),
        offsets: None,
        times: place.times,
        delay: place.delay,
        overlay: None,
    };
    in_place_of(place, node, width as f64 / height as f64)
}

/// Returns an object of another run in the place of a node.
///
/// # Errors
/// When the run has no atlas or no such object, or one of the two is a sphere.
pub(super) fn of_run(place: &Node, id: &str, run: &Path, from: &str) -> Result<Node, String> {
    let mut other = saved::read(run).map_err(|error| error.to_string())?;
    let number = outputs::find(&other, from)?;
    let mut node = other.nodes.swap_remove(number);
    let Surface::Plane { size, .. } = &node.surface else {
        return Err(format!("{from} of {} is a sphere", run.display()));
    };
    let proportion = size.x / size.y;
    id.clone_into(&mut node.id);
    in_place_of(place, node, proportion)
}

/// Returns a node moved to the place of another one, with the height of its plane and a proportion of width to height.
fn in_place_of(place: &Node, node: Node, proportion: f64) -> Result<Node, String> {
    let Surface::Plane { size, trajectory } = &place.surface else {
        return Err(format!(
            "{} is a sphere, and nothing can be inserted in its place",
            place.id
        ));
    };
    Ok(Node {
        surface: Surface::Plane {
            size: DVec2::new(proportion * size.y, size.y),
            trajectory: trajectory.clone(),
        },
        offsets: copied_offsets(place),
        times: place.times,
        delay: place.delay,
        ..node
    })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::tests::scene;

    fn size_of(node: &Node) -> Option<DVec2> {
        match &node.surface {
            Surface::Plane { size, .. } => Some(*size),
            Surface::Sphere { .. } => None,
        }
    }

    #[test]
    fn an_image_keeps_its_proportions_and_colours() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("logo.png");
        let image_of = image::RgbaImage::from_pixel(6, 3, image::Rgba([100, 200, 50, 128]));
        image_of.save(&path)?;
        let (mut graph, _) = scene();
        let place = &mut graph.nodes[0];
        place.delay = 0.25;
        let node = image(place, "logo", &path)?;
        let height = size_of(place).map(|size| size.y);
        assert_eq!(size_of(&node).map(|size| size.y), height);
        assert_eq!(size_of(&node).map(|size| size.x / size.y), Some(2.0));
        assert_eq!((node.id.as_str(), node.delay), ("logo", 0.25));
        let [red, green, blue] = node.colour.texels[7].map(f64::from);
        let straight = DVec3::new(red, green, blue) * 255.0;
        assert!(straight.distance(DVec3::new(100.0, 200.0, 50.0)) < 0.01);
        let opacity = node.opacity.map(|opacity| opacity.texels[7][0] * 255.0);
        assert!(opacity.is_some_and(|opacity| (opacity - 128.0).abs() < 0.01));
        place.surface = Surface::Sphere {
            centre: DVec3::ZERO,
            radius: 5.0,
        };
        let refused = image(place, "logo", &path).err();
        assert!(refused.is_some_and(|reason| reason.contains("is a sphere")));
        Ok(())
    }

    #[test]
    fn an_object_of_another_run_takes_the_place() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let (graph, _) = scene();
        saved::write(folder.path(), &graph)?;
        let [first, second] = [&graph.nodes[0], &graph.nodes[1]];
        let node = of_run(first, "guest", folder.path(), &second.id)?;
        assert_eq!(node.colour, second.colour);
        assert_eq!(node.given_pose(0.3).centre, first.given_pose(0.3).centre);
        let [place, own] = [first, second].map(size_of);
        let found = size_of(&node);
        assert_eq!(found.map(|size| size.y), place.map(|size| size.y));
        let proportions = [found, own].map(|size| size.map_or(0.0, |size| size.x / size.y));
        assert!((proportions[0] - proportions[1]).abs() < 1e-12);
        let unknown = of_run(first, "guest", folder.path(), "swan").err();
        assert!(unknown.is_some_and(|reason| reason.contains("swan")));
        Ok(())
    }
}
