// Equirectangular camera.

fn image_of_erp(n: vec3<f32>) -> vec2<f32> {
    let longitude = arc_tangent(n.x, n.z);
    let latitude = arc_tangent(-n.y, length(n.xz));
    return vec2(
        (longitude / TAU + 0.5) * f32(view.width),
        (0.5 - latitude / PI) * f32(view.height),
    );
}

fn project_erp(point: vec3<f32>, distance: f32) -> Projection {
    let n = point / distance;
    let frame = tangent_frame(n);
    return Projection(
        image_of_erp(n),
        frame[0] * (f32(view.width) / TAU / (length(n.xz) * distance)),
        frame[1] * (f32(view.height) / PI / distance),
    );
}

// `point` must not lie on the vertical axis.
fn project_erp_vjp(point: vec3<f32>, distance: f32, by: Projection) -> vec3<f32> {
    let kx = f32(view.width) / TAU;
    let ky = f32(view.height) / PI;
    let n = point / distance;
    let frame = tangent_frame(n);
    let x = n.x;
    let y = n.y;
    let z = n.z;
    let rho = length(n.xz);
    var gradient = frame[0] * (by.pixel.x * kx / (rho * distance))
        + frame[1] * (by.pixel.y * ky / distance);

    // d(J row u)/dp on the unit direction, where d = 1.
    let by_distance_squared = 1.0 / (distance * distance);
    let rho2 = rho * rho;
    let inverse_rho3 = 1.0 / (rho * rho * rho);
    let du0 = vec3(-2.0 * x * z, 0.0, rho2 - 2.0 * z * z);
    let du2 = vec3(2.0 * x * x - rho2, 0.0, 2.0 * x * z);
    gradient += (du0 * by.jacobian_u.x + du2 * by.jacobian_u.z)
        * (kx * by_distance_squared * inverse_rho3 / rho);
    // d(J row v)/dp on the unit direction.
    let mixed = x * y * z * (2.0 * rho2 + 1.0) * inverse_rho3;
    let level = (1.0 - 2.0 * y * y) / rho;
    let dv0 = vec3(-y * (z * z - 2.0 * x * x * rho2) * inverse_rho3, -x * level, mixed);
    let dv1 = vec3(-x * level, -2.0 * y * rho, -z * level);
    let dv2 = vec3(mixed, -z * level, -y * (x * x - 2.0 * z * z * rho2) * inverse_rho3);
    gradient += (dv0 * by.jacobian_v.x + dv1 * by.jacobian_v.y + dv2 * by.jacobian_v.z)
        * (ky * by_distance_squared);
    return gradient;
}
