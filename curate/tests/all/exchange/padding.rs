//! Images in padded frames: the same rays, masks over the padding, and refusals.

use glam::dvec2;
use omnilife_schemas::{
    RgbImage,
    camera::Camera,
    padded_frame::PaddedFrame,
    records::{Padding, Protocol, ScoredViews, SplitRule},
    split_rules,
};

use super::*;

const PINHOLE: PinholeCamera = PinholeCamera::new([32, 16], [21.25, 21.25], [15.5, 8.125]);

fn export_padded(
    format: &str,
    scene_folder: &Path,
    (split, pad_to): (Option<&Path>, Option<[u32; 2]>),
    out: &Path,
) -> Result<ExportScene, CurateError> {
    let request = ExportRequest {
        split,
        pad_to,
        ..ExportRequest::new(scene_folder, format, out)
    };
    export(&request, &Silent)
}

/// Returns true of pixels of a frame that are padding.
fn is_padding(frame: PaddedFrame, pixel: usize) -> bool {
    let column_row = [
        pixel as u32 % frame.size()[0],
        pixel as u32 / frame.size()[0],
    ];
    (0..2).any(|axis| {
        let first = frame.offset()[axis];
        !(first..first + frame.image()[axis]).contains(&column_row[axis])
    })
}

/// The image in a frame is the scene's, resized, and black is around it.
fn assert_shows(file: &Path, scene_image: &Path, frame: PaddedFrame) {
    let found = RgbImage::read(file).unwrap();
    assert_eq!(found.width as u32, frame.size()[0]);
    let [width, height] = frame.image().map(|side| side as usize);
    let expected = RgbImage::read(scene_image)
        .unwrap()
        .resized_by_area(width, height);
    let bytes = found.to_rgb8();
    assert_eq!(frame.crop(&bytes, 3), expected.to_rgb8());
    let mut pixels = bytes.chunks(3).enumerate();
    assert!(pixels.all(|(pixel, rgb)| !is_padding(frame, pixel) || rgb == [0, 0, 0]));
}

/// The mask of ignored pixels is the scene's, and the padding.
fn assert_ignores_padding(mask: &Mask, of_scene: Option<Mask>, frame: PaddedFrame) {
    let [width, height] = frame.image().map(|side| side as usize);
    let inside = of_scene.map_or(vec![0; width * height], |mask| {
        mask.resized_to_any(width, height).data
    });
    assert_eq!(mask.data, frame.pad(&inside, 1, 255));
}

#[test]
fn padded_perspective_frames_come_back_with_their_camera_and_masks_of_the_padding() {
    let (folder, mut original) = scene();
    original.camera = PINHOLE.into();
    store::write_record(&folder.path().join("scene.json"), &original).unwrap();
    let frame = PaddedFrame::fit([32, 16], [23, 10]).unwrap();
    assert_eq!((frame.image(), frame.offset()), ([20, 10], [1, 0]));
    for format in written_formats().filter(|format| format.id != "hm3d") {
        let out = tempfile::tempdir().unwrap();
        let (there, back) = (out.path().join("there"), out.path().join("back"));
        export_padded(format.id, folder.path(), (None, Some([23, 10])), &there).unwrap();
        assert!(!there.join("scratch").exists());
        let imported = import(&ImportRequest::new(&there, format.id, &original.id, &back)).unwrap();
        let Camera::Pinhole(camera) = imported.camera else {
            panic!("{}: {:?}", format.id, imported.camera);
        };
        assert_eq!([camera.width, camera.height], frame.size());
        assert_eq!(imported.frames.len(), 5);
        for (found, expected) in imported.frames.iter().zip(&original.frames) {
            let at = |file: &str| folder.path().join(file);
            assert_shows(&back.join(&found.image), &at(&expected.image), frame);
            let ignored = Mask::read(&back.join(found.ignore_mask.as_ref().unwrap())).unwrap();
            let of_scene = expected.ignore_mask.as_ref();
            let of_scene = of_scene.map(|file| Mask::read(&at(file)).unwrap());
            assert_ignores_padding(&ignored, of_scene, frame);
            if let Some(file) = &found.mask {
                let mask = Mask::read(&back.join(file)).unwrap();
                let mut pixels = mask.data.iter().enumerate();
                assert!(pixels.all(|(pixel, &value)| value == 0 || !is_padding(frame, pixel)));
            }
            let (pose, truth) = (found.pose.unwrap(), expected.pose.unwrap());
            for ahead in [dvec3(0.3, -0.2, 1.7), dvec3(-4.0, 2.5, 9.0)] {
                let world = truth.centre() + truth.rotation().unwrap() * ahead;
                let seen = pose.rotation().unwrap().inverse() * (world - pose.centre());
                let place = camera.project(seen).unwrap();
                let whole = PINHOLE.project(ahead).unwrap();
                let expected = dvec2(whole.x * 20.0 / 32.0 + 1.0, whole.y * 10.0 / 16.0);
                assert!(place.distance(expected) < 1e-9, "{}: {place}", format.id);
            }
        }
    }
}

/// Pixels have their directions at the place of the panorama by nerfstudio's rules.
#[test]
fn padded_panoramas_keep_their_directions() {
    let (folder, original) = scene();
    let out = tempfile::tempdir().unwrap();
    let there = out.path().join("there");
    export_padded("nerfstudio", folder.path(), (None, Some([16, 13])), &there).unwrap();
    let frame = PaddedFrame::fit([32, 16], [16, 13]).unwrap();
    assert_eq!((frame.image(), frame.offset()), ([16, 8], [0, 2]));
    let transforms = json(&there.join("transforms.json"));
    let entry = |name: &str| transforms[name].as_f64().unwrap();
    assert_eq!([entry("w"), entry("h")], [16.0, 13.0]);
    let panorama = ErpCamera::new(16, 8);
    for (column, row) in [(0, 0), (3, 2), (8, 4), (15, 7)] {
        let place = dvec2(f64::from(column) + 0.5, f64::from(row) + 0.5);
        let of_frame = place + dvec2(0.0, 2.0);
        // Cameras._generate_rays_from_coords, with y up and z back.
        let theta = -PI * (of_frame.x - entry("cx")) / entry("fl_x");
        let phi = PI * (0.5 + (of_frame.y - entry("cy")) / entry("fl_y"));
        let theirs = dvec3(
            -theta.sin() * phi.sin(),
            phi.cos(),
            -theta.cos() * phi.sin(),
        );
        let ours = panorama.unproject(place);
        assert!(theirs.distance(dvec3(ours.x, -ours.y, -ours.z)) < 1e-9);
    }
    for (number, expected) in original.frames[..5].iter().enumerate() {
        let image = there.join(format!("images/{number:06}.png"));
        assert_shows(&image, &folder.path().join(&expected.image), frame);
        let ignored = Mask::read(&there.join(format!("ignore/{number:06}.png"))).unwrap();
        let of_scene = expected.ignore_mask.as_ref();
        let of_scene = of_scene.map(|file| Mask::read(&folder.path().join(file)).unwrap());
        assert_ignores_padding(&ignored, of_scene, frame);
        let black = Mask::read(&there.join(format!("masks/{number:06}.png"))).unwrap();
        let mut pixels = black.data.iter().enumerate();
        assert!(pixels.all(|(pixel, &value)| value == 0 || !is_padding(frame, pixel)));
    }
    // Scenes have panoramas of the whole sphere.
    let imported = import(&ImportRequest::new(
        &there,
        "nerfstudio",
        &original.id,
        &out.path().join("back"),
    ));
    assert!(imported.is_err());
}

#[test]
fn formats_that_take_a_padded_panorama_for_the_sphere_refuse_it() {
    let (folder, _) = scene();
    for format in written_formats().filter(|format| !format.holds_padded_panoramas) {
        let out = tempfile::tempdir().unwrap();
        let there = out.path().join("there");
        let outcome = export_padded(format.id, folder.path(), (None, Some([16, 9])), &there);
        assert!(
            matches!(outcome, Err(CurateError::Input { .. })),
            "{}",
            format.id
        );
        assert!(!there.exists());
        // In proportion it fills its frame.
        let small = export_padded(format.id, folder.path(), (None, Some([16, 8])), &there).unwrap();
        assert_eq!((small.camera.size(), small.panorama), ([16, 8], None));
        assert!(small.frames[0].ignore_mask.is_none());
    }
}

#[test]
fn frames_are_those_of_the_split() {
    let (folder, mut original) = scene();
    original.camera = PINHOLE.into();
    store::write_record(&folder.path().join("scene.json"), &original).unwrap();
    let protocol = Protocol {
        padding: Padding::Frame {
            width: 40,
            height: 20,
        },
        ..Protocol::new(
            "test",
            SplitRule::EveryNth {
                period: 2,
                offset: 1,
            },
            ScoredViews::Novel,
        )
    };
    let file = folder.path().join("split.json");
    let split = split_rules::split(&original, &protocol).unwrap();
    store::write_record(&file, &split).unwrap();
    let out = tempfile::tempdir().unwrap();
    let there = |name: &str| out.path().join(name);
    let of_split = (Some(file.as_path()), None);
    let exported = export_padded("colmap", folder.path(), of_split, &there("a")).unwrap();
    // Nothing is enlarged.
    let shifted = PinholeCamera {
        width: 40,
        height: 20,
        cx: PINHOLE.cx + 4.0,
        cy: PINHOLE.cy + 2.0,
        ..PINHOLE
    };
    assert_eq!(exported.camera, shifted.into());
    let both = |size| (Some(file.as_path()), Some(size));
    export_padded("colmap", folder.path(), both([40, 20]), &there("b")).unwrap();
    for size in [[40, 21], [0, 20], [1 << 20, 20]] {
        let outcome = export_padded("colmap", folder.path(), both(size), &there("c"));
        assert!(
            matches!(outcome, Err(CurateError::Input { .. })),
            "{size:?}"
        );
    }
}
