//! A format from outside: a row with a writer, and nothing else.

use omnilife_curate::exchange::{Format, Part, Writer, export_as};

use super::*;

/// The names of the frames, one per line.
const TOY: Format = Format {
    id: "toy",
    about: "names of frames",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: Some(Writer {
        write: |scene, out| {
            let names = scene.frames.iter().map(|frame| format!("{}\n", frame.name));
            let names: String = names.collect();
            Ok(store::write_bytes(&out.join("toy.txt"), names.as_bytes())?)
        },
        holds: &[Part::Points],
    }),
    import: |folder| {
        Err(CurateError::Input {
            path: folder.to_owned(),
            reason: "is only written".to_owned(),
        })
    },
};

#[test]
fn a_format_is_a_row_and_a_writer() {
    let (folder, _) = scene();
    let out = tempfile::tempdir().unwrap();
    let request = ExportRequest {
        scene_folder: folder.path(),
        format: TOY.id,
        split: None,
        given_only: false,
        cube_faces: None,
        pad_to: None,
        out: &out.path().join("scene"),
    };
    assert!(export(&request, &Silent).is_err());
    let scene = export_as(&TOY, &request, &Silent).unwrap();
    let names = fs::read_to_string(request.out.join("toy.txt")).unwrap();
    assert_eq!(names.lines().count(), scene.frames.len());
    assert!(request.out.join("times.csv").is_file());
}
