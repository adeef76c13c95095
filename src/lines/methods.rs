//! The extractors for general scenes by their names, with default settings of their own.

use super::em::{Em, EmOptions};
use super::extractor::{Extractor, ExtractorOptions};
use super::hough::{
    FastHough, FastHoughOptions, Hough, HoughOptions, ModifiedHough, ModifiedHoughOptions,
};
use super::iepf::{Iepf, IepfOptions};
use super::incremental::{Incremental, IncrementalOptions};
use super::line_regression::{LineRegression, LineRegressionOptions};
use super::ml::{Ml, MlOptions};
use super::ransac::{Ransac, RansacOptions};
use super::split_and_merge::{SplitAndMerge, SplitAndMergeOptions};

/// The names: first the methods that cut the beams into runs, then those that take one line after
/// the other.
pub const METHODS: [&str; 10] = [
    "split-and-merge",
    "iepf",
    "incremental",
    "line-regression",
    "ml",
    "hough",
    "fast-hough",
    "modified-hough",
    "ransac",
    "em",
];

/// The extractor of that name, of [`METHODS`]; none for another one.
pub fn extractor(name: &str, common: ExtractorOptions) -> Option<Box<dyn Extractor>> {
    macro_rules! with_defaults {
        ($method:ident, $options:ident) => {
            Box::new($method::new($options {
                common,
                ..$options::default()
            }))
        };
    }
    let whole = HoughOptions {
        common,
        ..HoughOptions::default()
    };
    Some(match name {
        "split-and-merge" => with_defaults!(SplitAndMerge, SplitAndMergeOptions),
        "iepf" => with_defaults!(Iepf, IepfOptions),
        "incremental" => with_defaults!(Incremental, IncrementalOptions),
        "line-regression" => with_defaults!(LineRegression, LineRegressionOptions),
        "ml" => with_defaults!(Ml, MlOptions),
        "hough" => Box::new(Hough::new(whole)),
        "fast-hough" => with_defaults!(FastHough, FastHoughOptions),
        "modified-hough" => Box::new(ModifiedHough::new(ModifiedHoughOptions {
            whole,
            ..ModifiedHoughOptions::default()
        })),
        "ransac" => with_defaults!(Ransac, RansacOptions),
        "em" => with_defaults!(Em, EmOptions),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_has_its_method() {
        for name in METHODS {
            assert!(
                extractor(name, ExtractorOptions::default()).is_some(),
                "{name}"
            );
        }
        assert!(extractor("lines", ExtractorOptions::default()).is_none());
    }
}
