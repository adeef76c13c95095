//! Errors over time and by size.

use super::super::axis::{AXES, Axis};
use super::super::case::{AxisResult, Case};
use super::super::figure::{self, Course, HALF, THIRD, WHOLE};
use super::super::number::count;
use super::super::picture::Figure;
use super::Detail;

/// The components that get a course as wide as the page, and those that get half of it.
const WIDE: [usize; 2] = [0, 5];
const SMALL: [usize; 4] = [1, 2, 3, 4];

fn result(case: &Case, index: usize) -> Option<&AxisResult> {
    case.axes.get(index).filter(|a| a.statistics.n > 0)
}

/// The courses that fill a row; none where several runs share the page.
pub(super) fn wide(case: &Case, detail: Detail) -> Vec<Figure> {
    let axes: &[usize] = if detail.several { &[] } else { &WIDE };
    let axes = axes.iter();
    axes.filter_map(|i| course(case, *i, (WHOLE, 190), detail))
        .collect()
}

/// The courses two of which fill a row.
pub(super) fn small(case: &Case, detail: Detail) -> Vec<Figure> {
    let axes: &[usize] = if detail.several { &WIDE } else { &SMALL };
    let axes = axes.iter();
    axes.filter_map(|i| course(case, *i, (HALF, 150), detail))
        .collect()
}

fn course(case: &Case, index: usize, size: (u32, u32), detail: Detail) -> Option<Figure> {
    let result = result(case, index)?;
    let axis = AXES.get(index)?;
    let title = format!("Error in {}", axis.name);
    of(
        result,
        axis,
        [&format!("error-{}", axis.name), &title],
        size,
        true,
        detail,
    )
}

/// The course of a result with its figure's name and title; `signed` for one about zero, not from it;
/// as coarse as `detail` says.
pub(super) fn of(
    result: &AxisResult,
    axis: &Axis,
    [name, title]: [&str; 2],
    size: (u32, u32),
    signed: bool,
    detail: Detail,
) -> Option<Figure> {
    let title = if result.consistency.n > 0 {
        format!("{title}, with the solver’s ±3σ")
    } else {
        title.to_owned()
    };
    let (limit, beyond) = figure::trace_limit(&result.trace, &result.statistics);
    let mut unit = format!("{}, time in s", axis.symbol);
    if beyond > 0 {
        unit = format!("cut at {}; {unit}", axis.quantity(limit));
    }
    let top = limit * axis.factor;
    let course = Course {
        trace: &result.trace,
        factor: axis.factor,
        range: [if signed { -top } else { 0.0 }, top],
        step_px: detail.step_px(),
    };
    let drawing = figure::over_time(&course, size, &title);
    (result.statistics.n > 0).then(|| Figure::new(name, title, unit, drawing))
}

/// Histograms of the components; of three of them where several runs share the page.
pub(super) fn distributions(case: &Case, detail: Detail) -> Vec<Figure> {
    let axes: &[usize] = if detail.several {
        &[0, 2, 5]
    } else {
        &[0, 1, 2, 3, 4, 5]
    };
    let one = |index: &usize| {
        let result = result(case, *index)?;
        let axis = AXES.get(*index)?;
        // A component that was given has errors of rounding.
        if axis.quantity(result.statistics.max) == axis.quantity(0.0) {
            return None;
        }
        let beyond = result.histogram.beyond;
        let unit = if beyond > 0 {
            format!("{}; {} beyond", axis.symbol, count(beyond as usize))
        } else {
            axis.symbol.to_owned()
        };
        let label = format!("Distribution of the error in {}", axis.name);
        let size = (THIRD, 140);
        let drawing = figure::histogram(&result.histogram, &result.statistics, axis, size, &label);
        let name = format!("distribution-{}", axis.name);
        Some(Figure::new(
            &name,
            format!("Error in {}", axis.name),
            unit,
            drawing,
        ))
    };
    axes.iter().filter_map(one).collect()
}
