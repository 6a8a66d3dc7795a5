//! Assignment of rows to columns with the least sum of costs: the Hungarian method with potentials, by shortest
//! augmenting paths (Jonker and Volgenant 1987).

/// Returns the column of each row of a `rows x columns` matrix of finite costs; `None` where there are more rows than
/// columns.
pub fn assign(costs: &[Vec<f64>], columns: usize) -> Vec<Option<usize>> {
    let rows = costs.len();
    if rows == 0 || columns == 0 {
        return vec![None; rows];
    }
    if rows > columns {
        let turned: Vec<Vec<f64>> = (0..columns)
            .map(|column| costs.iter().map(|row| row[column]).collect())
            .collect();
        let mut assigned = vec![None; rows];
        for (column, row) in assign(&turned, rows).into_iter().enumerate() {
            if let Some(row) = row {
                assigned[row] = Some(column);
            }
        }
        return assigned;
    }
    // Rows and columns count from 1; column 0 stands for the row that is being added.
    let (mut by_row, mut by_column) = (vec![0.0; rows + 1], vec![0.0; columns + 1]);
    let mut row_of = vec![0_usize; columns + 1];
    for row in 1..=rows {
        let mut least = vec![f64::INFINITY; columns + 1];
        let mut from = vec![0_usize; columns + 1];
        let mut is_done = vec![false; columns + 1];
        row_of[0] = row;
        let mut column = 0;
        while row_of[column] != 0 {
            is_done[column] = true;
            let current = row_of[column];
            let (mut step, mut next) = (f64::INFINITY, 0);
            for other in (1..=columns).filter(|&other| !is_done[other]) {
                let reduced = costs[current - 1][other - 1] - by_row[current] - by_column[other];
                if reduced < least[other] {
                    least[other] = reduced;
                    from[other] = column;
                }
                if least[other] < step {
                    step = least[other];
                    next = other;
                }
            }
            for other in 0..=columns {
                if is_done[other] {
                    by_row[row_of[other]] += step;
                    by_column[other] -= step;
                } else {
                    least[other] -= step;
                }
            }
            column = next;
        }
        while column != 0 {
            row_of[column] = row_of[from[column]];
            column = from[column];
        }
    }
    let mut assigned = vec![None; rows];
    for (column, row) in row_of[1..].iter().enumerate() {
        if let Some(row) = row.checked_sub(1) {
            assigned[row] = Some(column);
        }
    }
    assigned
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the least sum over all ways to give each row a column; there are at least as many columns as rows.
    fn by_force(costs: &[Vec<f64>], used: &mut Vec<bool>) -> f64 {
        let Some((first, rest)) = costs.split_first() else {
            return 0.0;
        };
        let mut least = f64::INFINITY;
        for column in 0..used.len() {
            if !used[column] {
                used[column] = true;
                least = least.min(first[column] + by_force(rest, used));
                used[column] = false;
            }
        }
        least
    }

    #[test]
    fn sums_are_the_least_there_are() {
        let mut state = 1_u64;
        let mut random = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 40) as f64 / 1e6 - 8.0
        };
        for (rows, columns) in [(1, 1), (2, 5), (4, 4), (5, 6), (6, 6), (3, 1), (6, 4)] {
            for _ in 0..20 {
                let costs: Vec<Vec<f64>> = (0..rows)
                    .map(|_| (0..columns).map(|_| random()).collect())
                    .collect();
                let assigned = assign(&costs, columns);
                let pairs: Vec<(usize, usize)> = assigned
                    .iter()
                    .enumerate()
                    .filter_map(|(row, column)| Some((row, (*column)?)))
                    .collect();
                assert_eq!(pairs.len(), rows.min(columns));
                let mut taken: Vec<usize> = pairs.iter().map(|pair| pair.1).collect();
                taken.sort_unstable();
                taken.dedup();
                assert_eq!(taken.len(), pairs.len());
                let sum: f64 = pairs.iter().map(|&(row, column)| costs[row][column]).sum();
                let least = if rows <= columns {
                    by_force(&costs, &mut vec![false; columns])
                } else {
                    let turned: Vec<Vec<f64>> = (0..columns)
                        .map(|column| costs.iter().map(|row| row[column]).collect())
                        .collect();
                    by_force(&turned, &mut vec![false; rows])
                };
                assert!(
                    (sum - least).abs() < 1e-9,
                    "{rows}x{columns}: {sum} {least}"
                );
            }
        }
        assert_eq!(assign(&[], 3), []);
        assert_eq!(assign(&[vec![], vec![]], 0), [None, None]);
    }
}
