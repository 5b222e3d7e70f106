//! Gradients of batches, on several threads.

use crate::net::Net;
use crate::pass::Pass;

/// Sample of a training: fills the input, and turns the result into the loss and its gradient.
pub trait Sample: Send + Sync {
    /// What a result is compared with.
    type Truth;

    /// Writes the input's planes inside of their borders, and returns what the result is compared with.
    fn fill(&self, net: &Net, input: &mut [f32]) -> Self::Truth;

    /// Returns the loss of a result, and writes its gradient by the result inside of the borders of `pull`, whose border stays zero.
    fn judge(&self, net: &Net, truth: &Self::Truth, output: &[f32], pull: &mut [f32]) -> f64;
}

/// Mean loss of the samples, and its gradient in `gradient`. Each pass of `passes` works on a thread of its own.
///
/// The samples are added in their order, so that the result does not depend on the number of threads.
pub fn batch_gradient<S: Sample>(
    net: &Net,
    weights: &[f32],
    samples: &[S],
    passes: &mut [Pass],
    gradient: &mut [f32],
) -> f64 {
    mean_gradient(samples, passes, gradient, |sample, pass, gradient| {
        let truth = sample.fill(net, pass.input());
        pass.run(net, weights);
        let (output, pull) = pass.result(net);
        let loss = sample.judge(net, &truth, output, pull);
        pass.pull_back(net, weights, gradient);
        loss
    })
}

/// Sample with its loss and its gradient.
type Part<'a, S> = (&'a S, &'a mut (f64, Vec<f32>));

/// Mean loss of the samples, and its gradient in `gradient`. Each workspace is used on a thread of its own. `judge` returns the loss of a
/// sample and adds its gradient to the slice that it is given.
///
/// The samples are added in their order, so that the result does not depend on the number of threads.
pub fn mean_gradient<S: Sync, W: Send>(
    samples: &[S],
    workspaces: &mut [W],
    gradient: &mut [f32],
    judge: impl Fn(&S, &mut W, &mut [f32]) -> f64 + Sync,
) -> f64 {
    let mut parts: Vec<(f64, Vec<f32>)> = samples.iter().map(|_| (0.0, vec![0.0; gradient.len()])).collect();
    let threads = workspaces.len().max(1);
    let judge = &judge;
    #[allow(
        clippy::disallowed_methods,
        reason = "a training takes minutes on one core; its result does not depend on the threads"
    )]
    std::thread::scope(|scope| {
        // Sample k goes to thread k mod threads.
        let mut shares: Vec<Vec<Part<'_, S>>> = (0..threads).map(|_| Vec::new()).collect();
        for (k, pair) in samples.iter().zip(&mut parts).enumerate() {
            shares[k % threads].push(pair);
        }
        for (workspace, share) in workspaces.iter_mut().zip(shares) {
            scope.spawn(move || {
                for (sample, (loss, gradient)) in share {
                    *loss = judge(sample, workspace, gradient);
                }
            });
        }
    });
    let share = 1.0 / samples.len().max(1) as f32;
    gradient.fill(0.0);
    let mut total = 0.0;
    for (loss, part) in &parts {
        total += loss;
        gradient.iter_mut().zip(part).for_each(|(g, p)| *g += share * p);
    }
    total * f64::from(share)
}
