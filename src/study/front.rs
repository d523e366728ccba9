//! Which settings are worth their time: the Pareto front, and the time that each way of baking takes to the same error.

/// One bake: what it cost and how exact it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Price {
    /// Cost, such as seconds.
    pub cost: f64,
    /// Error.
    pub error: f64,
}

/// The indices of the bakes to which no other is at once no dearer and more exact, from the cheapest on.
pub fn front(prices: &[Price]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..prices.len()).collect();
    let key = |i: usize| (prices[i].cost, prices[i].error);
    order.sort_by(|&a, &b| key(a).0.total_cmp(&key(b).0).then(key(a).1.total_cmp(&key(b).1)));
    let mut least = f64::INFINITY;
    order.retain(|&i| {
        let better = prices[i].error < least;
        least = least.min(prices[i].error);
        better
    });
    order
}

/// The cost at which a way of baking reaches an error: log-log between its bakes, in the order of their cost. `None`
/// where it never does; the first cost where its first bake is exact enough.
pub fn cost_at(ladder: &[Price], error: f64) -> Option<f64> {
    let first = ladder.first()?;
    if first.error <= error {
        return Some(first.cost);
    }
    let pair = ladder.windows(2).find(|p| p[1].error <= error && error < p[0].error)?;
    let [(c0, e0), (c1, e1)] = [pair[0], pair[1]].map(|p| (libm::log(p.cost), libm::log(p.error)));
    Some(libm::exp(c0 + (c1 - c0) * (libm::log(error) - e0) / (e1 - e0)))
}
