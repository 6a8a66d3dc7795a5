//! Distances that a network estimated: aligned with the scene's, left out, or refused.

use super::*;

/// Gives a scene distances as a network estimates them: inverse distances have another scale and shift, and what
/// a car covers is nearer by its height. `size` is that of the files.
fn estimate_distances(folder: &Path, scene: &mut Scene, [width, height]: [usize; 2]) {
    const SCALE: f64 = 0.02;
    const SHIFT: f64 = 0.006;
    fs::create_dir_all(folder.join("depth-prior")).unwrap();
    let frames: Vec<u32> = (0..FRAMES as u32).collect();
    let axes = GroundAxes::new(DVec3::Z);
    for view in PosedView::of_scene(scene, &frames) {
        let boxes: Vec<[f64; 4]> = (0..3)
            .filter_map(|number| {
                let (centre, heading) = car(number, view.seconds);
                projected_box(&view, centre, axes.rotation(heading), [4.5, 1.8, 1.5])
            })
            .collect();
        let values: Vec<f32> = (0..width * height)
            .map(|at| {
                let u = ((at % width) as f64 + 0.5) * 320.0 / width as f64;
                let v = ((at / width) as f64 + 0.5) * 180.0 / height as f64;
                let is_car = boxes.iter().any(|&[left, top, columns, rows]| {
                    (left..left + columns).contains(&u) && (top..top + rows).contains(&v)
                });
                let ray = view.ray(glam::dvec2(u, v));
                let above = view.centre.z - if is_car { 1.5 } else { 0.0 };
                let distance = above / -ray.z;
                (SCALE / (1.0 / distance - SHIFT)) as f32
            })
            .collect();
        let file = format!("depth-prior/{:06}.npy", view.frame);
        npy::write_f32(&folder.join(&file), &[height, width], &values).unwrap();
        scene.frames[view.frame as usize].depth_prior = Some(DepthPrior {
            file,
            unit: 1.0,
            width: width as u32,
            height: height as u32,
            convention: DistanceConvention::Ray,
            source: "made up".to_owned(),
        });
    }
    store::write_record(&folder.join("scene.json"), scene).unwrap();
}

/// Estimates are left out where the ground lies under every box, and bring the same paths where they are asked
/// for.
#[test]
fn estimated_distances_are_aligned_and_left_out_where_there_is_ground() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("scene");
    let mut scene = write_scene(&folder);
    let given = boxes(&scene);
    let make = |distance: DistanceMethod| {
        let mut request = request(temp.path(), &given);
        request.options.distance = distance;
        make_tracks(&request, &Silent)
    };
    let refused = make(DistanceMethod::Monocular).unwrap_err();
    assert_eq!(refused.error_kind(), ErrorKind::User);
    assert!(refused.to_string().contains("--depth-prior"), "{refused}");
    estimate_distances(&folder, &mut scene, [160, 90]);
    let stage = |tracks: &omnilife_schemas::records::Tracks| {
        let stage = tracks
            .stages
            .iter()
            .find(|one| one.stage == "distance")
            .unwrap();
        (stage.method.clone(), stage.reason.clone())
    };
    // A point in a metre is too few around a box.
    let (method, reason) = stage(&make(DistanceMethod::Auto).unwrap());
    assert_eq!(method, "monocular");
    assert!(
        reason.contains("% of the boxes alone: estimates of 16"),
        "{reason}"
    );
    write_points(&folder, 150, 0.4);
    let (method, reason) = stage(&make(DistanceMethod::Auto).unwrap());
    assert_eq!(method, "ground");
    assert!(
        reason.contains("estimates are left out: ground lies under 100 % of the boxes"),
        "{reason}"
    );
    let tracks = make(DistanceMethod::Monocular).unwrap();
    let (method, reason) = stage(&tracks);
    assert_eq!(method, "monocular");
    assert!(
        reason.contains("16 frames aligned by scale and shift"),
        "{reason}"
    );
    assert_eq!(tracks.tracks.len(), 2, "{:?}", tracks.warnings);
    for track in &tracks.tracks {
        for seconds in [5.0, 7.0, 9.0] {
            let place = track.path.at(seconds).unwrap().0;
            let nearest = (0..2).map(|number| (place - car(number, seconds).0).length());
            let error = nearest.fold(f64::INFINITY, f64::min);
            assert!(error < 0.5, "{error} m at {seconds} s");
        }
    }
}

#[test]
fn estimates_that_cannot_be_used_are_refused_in_one_line() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("scene");
    let mut scene = write_scene(&folder);
    let given = boxes(&scene);
    estimate_distances(&folder, &mut scene, [160, 90]);
    let refusal = || {
        let mut request = request(temp.path(), &given);
        request.options.distance = DistanceMethod::Monocular;
        let error = make_tracks(&request, &Silent).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
        let message = error.to_string();
        assert!(!message.contains('\n'), "{message}");
        message
    };
    let file = folder.join("depth-prior/000000.npy");
    npy::write_f32(&file, &[90, 80], &vec![1.0; 90 * 80]).unwrap();
    let message = refusal();
    assert!(
        message.contains("000000.npy") && message.contains("is 80x90, the scene says 160x90"),
        "{message}"
    );
    // Numbers that have nothing to do with the scene.
    for frame in &scene.frames {
        let file = folder.join(&frame.depth_prior.as_ref().unwrap().file);
        let values: Vec<f32> = (0..160 * 90_u32)
            .map(|at| 1.0 + (at.wrapping_mul(2_654_435_761) >> 8) as f32)
            .collect();
        npy::write_f32(&file, &[90, 160], &values).unwrap();
    }
    let message = refusal();
    assert!(
        message.contains("agrees with fewer than 50 points of the scene in every frame"),
        "{message}"
    );
    assert!(!temp.path().join("tracks/tracks.json").exists());
}

#[test]
fn estimates_that_are_missing_are_told_before_anything_is_detected() {
    let temp = tempfile::tempdir().unwrap();
    let scene = write_scene(&temp.path().join("scene"));
    for distance in [DistanceMethod::Monocular, DistanceMethod::MonocularScale] {
        let mut request = request(temp.path(), &boxes(&scene));
        // Found out before the file of boxes, which has none, is read.
        fs::write(request.options.detections.as_ref().unwrap(), "no boxes").unwrap();
        request.options.distance = distance;
        let error = make_tracks(&request, &Silent).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
        let message = error.to_string();
        let expected = format!(
            "scene.json: has no estimated distances for --distance {}",
            distance.id()
        );
        assert!(message.contains(&expected), "{message}");
        assert!(!temp.path().join("tracks").exists());
    }
}
