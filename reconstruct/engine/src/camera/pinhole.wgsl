// The pinhole camera.

struct Slopes {
    // x/z and y/z, clamped.
    slope: vec2<f32>,
    // True for a slope inside its range.
    is_free: vec2<bool>,
}

fn slopes(point: vec3<f32>) -> Slopes {
    let size = vec2(f32(view.width), f32(view.height));
    let low = (-SLOPE_MARGIN * size - view.principal) / view.focal;
    let high = ((1.0 + SLOPE_MARGIN) * size - view.principal) / view.focal;
    let slope = point.xy / point.z;
    return Slopes(clamp(slope, low, high), (slope > low) & (slope < high));
}

fn project_pinhole(point: vec3<f32>) -> Projection {
    let clamped = slopes(point);
    let focal = view.focal;
    let inverse_z = 1.0 / point.z;
    return Projection(
        focal * point.xy * inverse_z + view.principal,
        vec3(focal.x, 0.0, -focal.x * clamped.slope.x) * inverse_z,
        vec3(0.0, focal.y, -focal.y * clamped.slope.y) * inverse_z,
    );
}

fn project_pinhole_vjp(point: vec3<f32>, by: Projection) -> vec3<f32> {
    let clamped = slopes(point);
    let focal = view.focal;
    let inverse_z = 1.0 / point.z;
    let inverse_z2 = inverse_z * inverse_z;
    let by_pixel = by.pixel * focal * inverse_z;
    var gradient = vec3(by_pixel, -dot(by_pixel, point.xy) * inverse_z);
    gradient.z -= (by.jacobian_u.x * focal.x + by.jacobian_v.y * focal.y) * inverse_z2;
    gradient.z += (by.jacobian_u.z * focal.x * clamped.slope.x
        + by.jacobian_v.z * focal.y * clamped.slope.y) * inverse_z2;
    // The slopes themselves: dJ02/dtx = -fx/z, dtx/dx = 1/z, dtx/dz = -x/z^2.
    let by_slope = select(
        vec2<f32>(),
        -focal * inverse_z * vec2(by.jacobian_u.z, by.jacobian_v.z),
        clamped.is_free,
    );
    gradient += vec3(by_slope * inverse_z, -dot(by_slope, point.xy) * inverse_z2);
    return gradient;
}
