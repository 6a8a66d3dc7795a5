//! Small valid files of our own.

use std::{fs, path::Path};

use omnilife_schemas::{
    Pose, RgbImage, Similarity,
    camera::ErpCamera,
    points::PointCloud,
    records::{PoseValidation, Scale, Scene, SceneFrame, ValidationStatus},
    store,
};

/// Returns the similarity that leaves the world unchanged.
pub(crate) fn unchanged() -> Similarity {
    Similarity::new([0.0; 3], 1.0)
}

/// Returns names as owned strings.
pub(crate) fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

/// Mask of 4 x 2 pixels with 2 bits each, by indices of a palette whose background is transparent.
pub(crate) const PALETTE_MASK: &[u8] = b"\x89PNG\x0d\x0a\x1a\x0a\x00\x00\x00\x0dIHDR\x00\x00\x00\x04\x00\x00\x00\x02\x02\x03\x00\x00\x00\x02\xc6\x95\xf0\x00\x00\x00\x09PLTE\x00\x00\x00\x80\x00\x00\x00@\x00m\xaa\xb2\x1d\x00\x00\x00\x01tRNS\x00@\xe6\xd8f\x00\x00\x00\x0cIDATx\xdac\x90`\x08\x00\x00\x00\x9c\x00iV,*\xc3\x00\x00\x00\x00IEND\xaeB`\x82";

/// Returns two points.
pub(crate) fn cloud() -> PointCloud {
    PointCloud {
        positions: vec![[0.0, 1.0, 2.0], [1.0, -1.0, 3.0]],
        colours: vec![[255, 0, 0], [0, 128, 255]],
    }
}

/// Returns two Gaussians of degree 0 as 3DGS writes them.
pub(crate) fn gaussians() -> Vec<u8> {
    let mut properties = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"].to_vec();
    properties.extend([
        "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
    ]);
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 2\n".to_vec();
    for property in &properties {
        bytes.extend(format!("property float {property}\n").bytes());
    }
    bytes.extend(b"end_header\n");
    for value in 0..2 * properties.len() {
        bytes.extend((value as f32 * 0.1).to_le_bytes());
    }
    bytes
}

/// A `.splat` of three equal Gaussians; names it.
pub(crate) fn write_splat(folder: &Path) -> Vec<String> {
    let mut row = Vec::new();
    for value in [0.5_f32, -1.0, 2.0, 0.1, 0.2, 0.3] {
        row.extend(value.to_le_bytes());
    }
    row.extend([200, 100, 50, 255, 255, 128, 128, 128]);
    fs::write(folder.join("a.splat"), row.repeat(3)).unwrap();
    names(&["a.splat"])
}

/// Files of Gaussians of another program, one of each format and version; names them.
pub(crate) fn write_splat_formats(folder: &Path) -> Vec<String> {
    let peer = "reconstruct/training/src/formats/exchange/peer";
    let peer = Path::new(env!("CARGO_MANIFEST_DIR")).join(peer);
    let files = [
        "version-3.spz",
        "version-4.spz",
        "peer.compressed.ply",
        "peer.glb",
        "peer.sog",
    ];
    for file in files {
        fs::copy(peer.join(file), folder.join(file)).unwrap();
    }
    names(&files)
}

/// Gaussians in time with every motion; names the file.
pub(crate) fn write_gaussians_in_time(folder: &Path) -> Vec<String> {
    let peer = "reconstruct/training/src/formats/in_time/peer/peer.gtime";
    let peer = Path::new(env!("CARGO_MANIFEST_DIR")).join(peer);
    fs::copy(peer, folder.join("peer.gtime")).unwrap();
    names(&["peer.gtime"])
}

/// A scene of three small images, with points.
pub(crate) fn write_scene(folder: &Path) {
    let frame = |number: usize| {
        SceneFrame::new(
            format!("frames/{number:06}.png"),
            0.1 * number as f64,
            Some(Pose {
                rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
                centre: [number as f64, 0.0, 0.0],
            }),
        )
    };
    let scene = Scene {
        scale: Scale::Metres,
        points: Some("points.ply".to_owned()),
        validation: PoseValidation {
            status: ValidationStatus::Valid,
            registered_frames: 3,
            total_frames: 3,
            measures: [].into(),
            problems: Vec::new(),
        },
        ..Scene::given(
            "a/seq-000",
            ErpCamera::new(16, 8),
            (0..3).map(frame).collect(),
        )
    };
    fs::create_dir_all(folder.join("frames")).unwrap();
    for frame in &scene.frames {
        let file = folder.join(&frame.image);
        RgbImage::black(16, 8).write_png(&file).unwrap();
    }
    cloud().write_ply(&folder.join("points.ply")).unwrap();
    store::write_record(&folder.join("scene.json"), &scene).unwrap();
}

/// Writes three small panoramas into a folder, under these names.
fn write_panoramas(folder: &Path, names: [&str; 3]) {
    fs::create_dir_all(folder).unwrap();
    for name in names {
        RgbImage::black(16, 8)
            .write_png(&folder.join(name))
            .unwrap();
    }
}

/// Writes a scene of 360Roam to the folder `in`; returns the names of the files to change.
pub(crate) fn write_roam360(folder: &Path) -> Vec<String> {
    write_panoramas(&folder.join("in/images"), ["0.png", "1.png", "2.png"]);
    let entry = |number: u32| {
        serde_json::json!({
            "rgb_file": format!("{number}.png"),
            "transform_matrix": [
                [0.0, 0.0, 1.0, f64::from(number)], [0.0, 1.0, 0.0, 0.5], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
        })
    };
    let poses = serde_json::json!({"train": [entry(0), entry(2)], "test": [entry(1)]});
    fs::write(folder.join("in/pose_c2w.json"), poses.to_string()).unwrap();
    cloud().write_ply(&folder.join("in/scene.ply")).unwrap();
    names(&["in/pose_c2w.json", "in/scene.ply"])
}

/// Writes a scene of OmniPhotos to the folder `in`; returns the names of the files to change.
pub(crate) fn write_omniphotos(folder: &Path) -> Vec<String> {
    write_panoramas(&folder.join("in/Input"), ["p-7.png", "p-8.png", "p-9.png"]);
    let files = [
        (
            "in/Config/modelFiles.openvslam",
            b"../Capture/openvslam/cameras.txt\n../Capture/openvslam/trajectory.txt\n\
              ../Capture/openvslam/map.msg"
                .to_vec(),
        ),
        (
            "in/Capture/openvslam/cameras.txt",
            b"# 1\r\n1 EQUIRECTANGULAR 16 8 500 8.0 4.0\r\n".to_vec(),
        ),
        (
            "in/Capture/openvslam/trajectory.txt",
            b"#index filename\r\n7 p-7.png 0 0 0 0 0 0 1\r\n8 p-8.png 1 0.5 0 0 0.6 0 0.8\r\n\
              -1 p-9.png 2 0 0 0 0 0 1\r\n"
                .to_vec(),
        ),
        (
            "in/Capture/openvslam/map.msg",
            b"\x82\xa9keyframes\x81\xa10\x92\xcc\xc8\x91\xff\xa9landmarks\x81\xa15\x81\xa5pos_w\x93\xca\x3f\x80\
              \x00\x00\xcb\x3f\xf0\x00\x00\x00\x00\x00\x00\x03"
                .to_vec(),
        ),
    ];
    for (name, bytes) in &files {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    names(&files.each_ref().map(|(name, _)| *name))
}

/// Writes tracks of that scene: one object that moves.
pub(crate) fn write_tracks(folder: &Path) {
    let tracks = serde_json::json!({
        "schema": "omnilife/tracks/1", "scene": "a/seq-000", "frames": [0, 1, 2], "image_size": [16, 8],
        "up": [0.0, -1.0, 0.0], "metres_per_unit": 1.0, "warnings": [],
        "stages": [{"stage": "detector", "method": "files", "reason": "two boxes", "wall_seconds": 0.1}],
        "detections": [
            {"frame": 0, "box_pixels": [2.0, 3.0, 4.0, 2.0], "confidence": 1.0, "class": "vehicle",
             "distance": 4.0, "position": [0.0, 0.5, 4.0], "track": 1},
            {"frame": 1, "box_pixels": [3.0, 3.0, 4.0, 2.0], "confidence": 0.5, "class": "vehicle",
             "distance": null, "position": null, "track": null}],
        "tracks": [{
            "id": 1, "class": "vehicle", "dimensions": [4.5, 1.8, 1.5], "detections": 1, "displacement": 2.0,
            "path": {
                "centre": {"degree": 1, "knots": [0.0, 0.0, 0.2, 0.2],
                           "coefficients": [[0.0, 0.5, 4.0], [2.0, 0.5, 4.0]]},
                "heading_seconds": [0.0, 0.2], "headings": [0.0, 3.0]}}],
    });
    fs::write(folder.join("tracks.json"), tracks.to_string()).unwrap();
}

/// Returns the boxes of an MP4 file that states its projection in both versions.
pub(crate) fn spherical_mp4() -> Vec<u8> {
    let boxed = |kind: &[u8; 4], content: &[u8]| -> Vec<u8> {
        let length = content.len() as u32 + 8;
        [&length.to_be_bytes()[..], kind, content].concat()
    };
    let mut header = vec![0; 84];
    header[15] = 1;
    let mut id = vec![
        0xff, 0xcc, 0x82, 0x63, 0xf8, 0x55, 0x4a, 0x93, 0x88, 0x14, 0x58, 0x7a, 0x02, 0x52, 0x1f,
        0xdd,
    ];
    id.extend(
        b"<rdf:SphericalVideo><GSpherical:Spherical>true</GSpherical:Spherical>\
          <GSpherical:ProjectionType>equirectangular</GSpherical:ProjectionType>\
          <GSpherical:StereoMode>mono</GSpherical:StereoMode></rdf:SphericalVideo>",
    );
    let projection = boxed(
        b"proj",
        &[boxed(b"prhd", &[0; 16]), boxed(b"equi", &[0; 20])].concat(),
    );
    let inside = [boxed(b"st3d", &[0; 5]), boxed(b"sv3d", &projection)].concat();
    let entry = boxed(b"avc1", &[vec![0; 78], inside].concat());
    let description = boxed(b"stsd", &[vec![0, 0, 0, 0, 0, 0, 0, 1], entry].concat());
    let media = boxed(b"mdia", &boxed(b"minf", &boxed(b"stbl", &description)));
    let track = boxed(
        b"trak",
        &[boxed(b"tkhd", &header), boxed(b"uuid", &id), media].concat(),
    );
    [
        boxed(b"ftyp", b"isom"),
        boxed(b"moov", &track),
        boxed(b"mdat", &[1, 2, 3]),
    ]
    .concat()
}
