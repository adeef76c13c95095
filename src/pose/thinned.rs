//! A run of any length in bounded memory.

/// Evenly spread items of a run, fewer than `MOST`: whenever there are so many, every second one goes,
/// and of what follows only every second one is kept.
#[derive(Clone, Debug)]
pub(super) struct Thinned<T, const MOST: usize> {
    kept: Vec<T>,
    /// Of so many items one is kept.
    every: usize,
    seen: usize,
}

impl<T, const MOST: usize> Default for Thinned<T, MOST> {
    fn default() -> Self {
        Thinned {
            kept: Vec::new(),
            every: 1,
            seen: 0,
        }
    }
}

impl<T, const MOST: usize> Thinned<T, MOST> {
    /// Takes the next item, which is made only where it is kept.
    pub(super) fn add(&mut self, item: impl FnOnce() -> T) {
        if self.seen.is_multiple_of(self.every) {
            self.kept.push(item());
            if self.kept.len() == MOST {
                let mut stays = false;
                self.kept.retain(|_| {
                    stays = !stays;
                    stays
                });
                self.every *= 2;
            }
        }
        self.seen += 1;
    }

    /// What is kept, in the run's order.
    pub(super) fn kept(&self) -> &[T] {
        &self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_evenly_spread() {
        let mut thinned = Thinned::<usize, 8>::default();
        for k in 0..1000 {
            thinned.add(|| k);
            let kept = thinned.kept();
            assert!(kept.len() < 8 && kept[0] == 0);
            assert!(k < 7 || kept.len() > 3, "{k}: {kept:?}");
            let step = kept.get(1).map_or(1, |second| *second);
            assert!(kept.iter().enumerate().all(|(i, item)| *item == i * step));
            assert!(k - kept[kept.len() - 1] < step);
        }
    }
}
