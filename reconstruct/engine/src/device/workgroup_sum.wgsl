// Sums over the threads of a workgroup, always in the same order.

var<workgroup> sums: array<f32, WORKGROUP>;

// Sum of all threads' values, returned to each of them. Must be called by every thread.
fn workgroup_sum(value: f32, thread: u32) -> f32 {
    sums[thread] = value;
    workgroupBarrier();
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        if thread < half {
            sums[thread] += sums[thread + half];
        }
        workgroupBarrier();
    }
    return sums[0];
}
