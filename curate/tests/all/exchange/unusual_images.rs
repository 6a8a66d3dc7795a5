//! Images that programs see differently: transparent in places, or to be turned.

use image::{
    DynamicImage, ExtendedColorType, ImageEncoder, ImageFormat, RgbaImage, codecs::png::PngEncoder,
};

use super::{
    foreign::{Foreign, write_colmap_text},
    *,
};

/// A sphere of 32 x 16 pixels whose lowest rows are hidden behind a colour of their own.
fn hidden_below(row: u32) -> RgbaImage {
    RgbaImage::from_fn(32, 16, |x, y| {
        if y < row {
            image::Rgba([(8 * x) as u8, (16 * y) as u8, 90, 255])
        } else {
            image::Rgba([255, 0, 255, 0])
        }
    })
}

fn transforms(images: &[&str]) -> String {
    let frames = images.iter().map(|name| {
        serde_json::json!({
            "file_path": name,
            "transform_matrix": [[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        })
    });
    let frames: Vec<Value> = frames.collect();
    serde_json::json!({"camera_model": "EQUIRECTANGULAR", "w": 32, "h": 16, "frames": frames})
        .to_string()
}

fn bytes(image: &RgbaImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = DynamicImage::ImageRgba8(image.clone());
    match format {
        ImageFormat::Png => image.write_to(&mut bytes, format).unwrap(),
        _ => image.to_rgb8().write_to(&mut bytes, format).unwrap(),
    }
    bytes.into_inner()
}

/// Transparent pixels are ignored: their colour is in no frame, and a mask marks them.
#[test]
fn what_is_transparent_is_no_part_of_the_scene() {
    let foreign = Foreign::new([32, 16], &[]);
    let image = hidden_below(11);
    foreign.write("images/a.png", bytes(&image, ImageFormat::Png));
    let opaque = hidden_below(16);
    foreign.write("images/b.png", bytes(&opaque, ImageFormat::Png));
    foreign.write(
        "transforms.json",
        transforms(&["images/a.png", "images/b.png"]),
    );
    let scene = foreign.import("nerfstudio").unwrap();
    let out = foreign.path().join("out");
    let [a, b] = &scene.frames[..] else {
        panic!("{scene:?}")
    };
    assert_eq!(b.ignore_mask, None);
    let mask = Mask::read(&out.join(a.ignore_mask.as_ref().unwrap())).unwrap();
    let marked = mask.data.iter().filter(|&&value| value != 0).count();
    assert_eq!(marked, 5 * 32);
    let written = image::open(out.join(&a.image)).unwrap();
    assert!(!written.color().has_alpha());
    for (written, given) in written.to_rgb8().pixels().zip(image.pixels()) {
        let expected = if given.0[3] == 0 {
            [0; 3]
        } else {
            [given.0[0], given.0[1], given.0[2]]
        };
        assert_eq!(written.0, expected);
    }
    let told = |words: &str| {
        scene
            .validation
            .problems
            .iter()
            .any(|line| line.contains(words))
    };
    assert!(
        told("transparent") && told("a.png"),
        "{:?}",
        scene.validation.problems
    );
    // An image that is the same for everybody is copied byte for byte.
    assert_eq!(
        fs::read(out.join(&b.image)).unwrap(),
        bytes(&opaque, ImageFormat::Png)
    );
}

/// A JPEG with an EXIF block that asks to be mirrored left to right, or turned by 180 degrees.
fn with_orientation(jpeg: &[u8], orientation: u8) -> Vec<u8> {
    let mut tiff = b"II\x2a\x00\x08\x00\x00\x00\x01\x00".to_vec();
    tiff.extend([
        0x12,
        0x01,
        3,
        0,
        1,
        0,
        0,
        0,
        orientation,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
    ]);
    let body = [&b"Exif\0\0"[..], &tiff].concat();
    let length = (body.len() as u16 + 2).to_be_bytes();
    [&jpeg[..2], &[0xff, 0xe1], &length, &body, &jpeg[2..]].concat()
}

/// Viewers turn such images, and so does the import of panoramas. The data set of nerfstudio does not.
#[test]
fn what_asks_to_be_turned_is_turned_once_or_not_at_all() {
    let image = hidden_below(16);
    let jpeg = bytes(&image, ImageFormat::Jpeg);
    let plain = image::load_from_memory(&jpeg).unwrap().to_rgb8();
    for (orientation, turned) in [
        (2, image::imageops::flip_horizontal(&plain)),
        (3, image::imageops::rotate180(&plain)),
    ] {
        for (format, folder, expected) in [
            ("nerfstudio", "images/", &plain),
            ("panoramas", "", &turned),
        ] {
            let foreign = Foreign::new([32, 16], &[]);
            let names = ["a.jpg", "b.jpg"].map(|name| format!("{folder}{name}"));
            foreign.write(&names[0], with_orientation(&jpeg, orientation));
            foreign.write(&names[1], &jpeg);
            if format == "nerfstudio" {
                let names = [names[0].as_str(), names[1].as_str()];
                foreign.write("transforms.json", transforms(&names));
            }
            let scene = foreign.import(format).unwrap();
            let path = |at: usize| foreign.path().join("out").join(&scene.frames[at].image);
            let shown = |at: usize| image::open(path(at)).unwrap().to_rgb8();
            assert_eq!(shown(0), *expected, "{orientation}, {format}");
            assert_eq!(shown(1), plain);
            let problems = &scene.validation.problems;
            assert!(
                problems
                    .iter()
                    .any(|line| line.contains("EXIF data") && line.contains("a.jpg")),
                "{problems:?}"
            );
            // It is not turned again.
            assert!(omnilife_schemas::RgbImage::read(&path(0)).is_ok());
            let source = foreign.path().join("in").join(&names[0]);
            assert!(
                omnilife_schemas::RgbImage::read(&source).is_err(),
                "read as it is, it is refused"
            );
        }
    }
}

/// A phone that is held upright: COLMAP's camera is that of the sensor, and its poses and lens are so too.
#[test]
fn portraits_in_a_colmap_model_stay_as_the_sensor_has_them() {
    let jpeg = bytes(&hidden_below(16), ImageFormat::Jpeg);
    for camera in [
        "1 PINHOLE 32 16 30 30 16 8\n",
        "1 SIMPLE_RADIAL 32 16 30 16 8 -0.2\n",
    ] {
        let foreign = Foreign::new([32, 16], &[]);
        foreign.write("images/1.jpg", with_orientation(&jpeg, 6));
        foreign.write("images/2.jpg", &jpeg);
        write_colmap_text(
            &foreign,
            "sparse/0",
            camera,
            &[(1, 1, "1.jpg", 1), (2, 1, "2.jpg", 2)],
        );
        let scene = foreign.import("colmap").unwrap();
        let shown = |at: usize| {
            let path = foreign.path().join("out").join(&scene.frames[at].image);
            omnilife_schemas::RgbImage::read(&path).unwrap()
        };
        assert_eq!((shown(0).width, shown(0).height), (32, 16));
        assert_eq!(shown(0), shown(1), "{camera}");
    }
}

/// Separators of Windows and names without endings lead to the files that are there, with a line.
#[test]
fn names_of_other_systems_are_found() {
    let foreign = Foreign::new([32, 16], &[("images/a.png", 1), ("images/b.png", 2)]);
    let text = transforms(&["images\\a.png", "images/b"]);
    foreign.write("transforms.json", text);
    let scene = foreign.import("nerfstudio").unwrap();
    assert_eq!(foreign.shown(&scene), [(1, 0), (2, 10)]);
    let problems = &scene.validation.problems;
    let renamed = problems.iter().find(|line| line.contains("other names"));
    assert!(
        renamed.is_some_and(|line| line.contains("images\\a.png as images/a.png")
            && line.contains("images/b as images/b.png")),
        "{problems:?}"
    );
    // Two files of that name are no answer.
    foreign.write("images/b.jpg", "another");
    assert_eq!(foreign.import("nerfstudio").unwrap().frames.len(), 1);
}

#[cfg(unix)]
#[test]
fn a_link_without_its_target_is_called_one() {
    let foreign = Foreign::new([32, 16], &[("images/a.png", 1)]);
    let link = foreign.path().join("in/images/b.png");
    std::os::unix::fs::symlink("/nonexistent/b.png", &link).unwrap();
    let names = ["images/a.png", "images/b.png"];
    foreign.write("transforms.json", transforms(&names));
    let problems = foreign.import("nerfstudio").unwrap().validation.problems;
    let is_told = |line: &String| line.contains("link") && line.contains("images/b.png");
    assert!(problems.iter().any(is_told), "{problems:?}");
    foreign.write("transforms.json", transforms(&names[1..]));
    let line = foreign.refusal("nerfstudio");
    assert!(line.contains("a link whose target is missing"), "{line}");
    let error = omnilife_schemas::image_file::ImageFile::open(&link).err();
    let line = error.unwrap().to_string();
    assert!(line.contains("a link whose target is missing"), "{line}");
}

/// Profiles are not applied and 16 bits not kept, each with a line; the files are copied as they are.
#[test]
fn colours_that_are_lost_are_told() {
    let foreign = Foreign::new([32, 16], &[("images/a.png", 1)]);
    let deep = image::ImageBuffer::<image::Rgb<u16>, _>::new(32, 16);
    deep.save(foreign.path().join("in/images/b.png")).unwrap();
    let mut profiled = Vec::new();
    let mut encoder = PngEncoder::new(&mut profiled);
    // A profile without a description is of unknown colours.
    encoder.set_icc_profile(vec![0; 132]).unwrap();
    let pixels = vec![90_u8; 3 * 32 * 16];
    let colour = ExtendedColorType::Rgb8;
    encoder.write_image(&pixels, 32, 16, colour).unwrap();
    foreign.write("images/c.png", &profiled);
    let names = ["images/a.png", "images/b.png", "images/c.png"];
    foreign.write("transforms.json", transforms(&names));
    let scene = foreign.import("nerfstudio").unwrap();
    let problems = &scene.validation.problems;
    for (words, name) in [("colour profile", "c.png"), ("16 bits", "b.png")] {
        let mut lines = problems.iter().filter(|line| line.contains(words));
        let line = lines.next().unwrap();
        assert!(line.starts_with("1 ") && line.ends_with(name), "{line}");
        assert_eq!(lines.next(), None);
    }
    let copied = fs::read(foreign.path().join("out").join(&scene.frames[2].image));
    assert_eq!(copied.unwrap(), profiled);
}

/// Older versions of `ns-process-data` name no points, and others leave theirs beside a file of another program.
#[test]
fn points_that_no_file_names_are_told() {
    let foreign = Foreign::new([32, 16], &[("images/a.png", 1)]);
    let ply = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
               end_header\n1 2 3\n";
    foreign.write("sparse_pc.ply", ply);
    let text = transforms(&["images/a.png"]);
    for (text, are_read) in [
        (text.clone(), false),
        (
            text.replacen('{', "{\"ply_file_path\": \"sparse_pc.ply\",", 1),
            true,
        ),
    ] {
        foreign.write("transforms.json", text);
        let scene = foreign.import("nerfstudio").unwrap();
        assert_eq!(scene.points.is_some(), are_read);
        let problems = &scene.validation.problems;
        let is_told = problems.iter().any(|line| line.contains("sparse_pc.ply"));
        assert_eq!(is_told, !are_read, "{problems:?}");
    }
}
