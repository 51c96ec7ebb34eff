// Which matches of a frame belong together: the largest set that one of its members explains
// ("1-point RANSAC", Civera et al. 2010). One match and what the filter expects fix the camera well
// enough to judge the others, so that a handful of hypotheses is all there are.
#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

namespace waymark::slam {

// Innovations of `count` matches, two numbers each, and their covariance by rows, of which the
// lower triangle is looked at. All correlations count: after one match is believed, the others are
// expected where the filter would expect them then, to within what would still be open. Marks those
// whose squared Mahalanobis distance stays below `chi2` in the best hypothesis; at most
// `hypotheses` are tried, spread over the matches. `marked` has count entries.
void findConsensus(const double* residuals, const double* S, int stride, int count, double chi2,
                   int hypotheses, std::vector<char>* marked);

// Of those marked, what all the others together contradict: one after the other, the worst first,
// until each is within `chi2` of where the rest expects it. One match leaves open where the others
// are by some pixels (a roll, a step aside), which is where the next window of a facade is.
class Refuter {
 public:
  explicit Refuter(int max_count);

  // As findConsensus(); excess: what is in S of each match's noise beyond what it scatters by in
  // one frame, which is all that the others know nothing of. Clears marks. Nothing is cleared when
  // S is not positive definite without it.
  void refute(const double* residuals, const double* S, int stride,
              std::span<const Eigen::Matrix2d> excess, double chi2, std::vector<char>* marked);

 private:
  [[nodiscard]] bool invert(int n);
  void leaveOut(int n, int i);

  int stride_;
  std::vector<int> match_;           // of those looked at
  std::vector<double> information_;  // of the innovations, n x n
  std::vector<double> weighted_;     // information times residuals
  std::vector<char> out_;
};

}  // namespace waymark::slam
