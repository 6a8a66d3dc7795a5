//! Small valid scenes in the layouts of datasets.

use std::{fs, io::Cursor, path::Path};

use omnilife_schemas::RgbImage;

use crate::samples::names;

/// Writes files below the folder `in`, those that end in `.png` as black panoramas of 16 x 8; returns the names of
/// the others.
fn written(folder: &Path, files: &[(&str, &str)]) -> Vec<String> {
    let mut found = Vec::new();
    for (name, content) in files {
        let name = format!("in/{name}");
        let path = folder.join(&name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        if name.ends_with(".png") {
            RgbImage::black(16, 8).write_png(&path).unwrap();
        } else {
            fs::write(&path, content).unwrap();
            found.push(name);
        }
    }
    found.sort();
    found
}

/// Writes `OmniBlender`: two panoramas.
pub(crate) fn write_omniblender(folder: &Path) -> Vec<String> {
    let transform = r#"{"indoor": true, "frames": [
        {"file_path": "0.png", "transform_matrix": [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
        {"file_path": "1.png", "transform_matrix": [[1, 0, 0, 0], [0, 0, -1, 2], [0, 1, 0, 0], [0, 0, 0, 1]]}]}"#;
    let files = [
        ("images/0.png", ""),
        ("images/1.png", ""),
        ("transform.json", transform),
        ("train.txt", "0\n"),
        ("test.txt", "1\n"),
    ];
    written(folder, &files)
}

/// Writes `Ricoh360`: two panoramas and a point.
pub(crate) fn write_ricoh360(folder: &Path) -> Vec<String> {
    let images = "# list\n1 1 0 0 0 0.5 0 0 0 7.jpg\n\n2 0 1 0 0 0 0 1 0 8.jpg\n1.5 2.5 4\n";
    let files = [
        ("imgs/7.png", ""),
        ("imgs/8.png", ""),
        ("output_dir/colmap/images.txt", images),
        (
            "output_dir/colmap/points3D.txt",
            "4 0.5 -1.25 3 250 3 7 0.4 1 0\n",
        ),
        ("train.txt", "7\n"),
        ("test.txt", "8\n"),
    ];
    written(folder, &files)
}

/// Writes `OB3D`: two panoramas and a point.
pub(crate) fn write_ob3d(folder: &Path) -> Vec<String> {
    let camera = r#"[{"id": 0, "width": 16, "height": 8, "extrinsics": {
        "rotation": [[1, 0, 0], [0, 0, -1], [0, 1, 0]], "translation": [0.5, -1.0, 2.0]}}]"#;
    let points = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                  property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 3 4 5 6\n";
    let files = [
        ("images/00000_rgb.png", ""),
        ("images/00001_rgb.png", ""),
        ("cameras/00000_cam.json", camera),
        ("cameras/00001_cam.json", camera),
        ("sparse/sparse.ply", points),
        ("train.txt", "0\n"),
        ("test.txt", "00001_rgb\n"),
    ];
    written(folder, &files)
}

/// Writes `TartanAir` V2: two panoramas, one of them with distances, which are changed as well.
pub(crate) fn write_tartanair(folder: &Path) -> Vec<String> {
    let poses = "0 0 0 0 0 0 1\n1.5e0 -2 0.25 0 0 1 0\n";
    let files = [
        ("image_lcam_equirect/000000_lcam_equirect_image.png", ""),
        ("image_lcam_equirect/000001_lcam_equirect_image.png", ""),
        ("pose_lcam_front.txt", poses),
    ];
    written(folder, &files);
    // 1 m everywhere: 0x3f800000.
    let metre = image::Rgba([0x80, 0x00, 0x00, 0x3f]);
    let mut png = Cursor::new(Vec::new());
    image::RgbaImage::from_pixel(16, 8, metre)
        .write_to(&mut png, image::ImageFormat::Png)
        .unwrap();
    let depth = "in/depth_lcam_equirect/000000_lcam_equirect_depth.png";
    fs::create_dir_all(folder.join(depth).parent().unwrap()).unwrap();
    fs::write(folder.join(depth), png.get_ref()).unwrap();
    names(&[depth, "in/pose_lcam_front.txt"])
}
