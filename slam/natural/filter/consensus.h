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

// Of those marked, what the others together contradict. One match leaves open where the others are
// by some pixels (a roll, a step aside), which is where the next window of a facade is.
//
// The older half is judged first, among itself: one after the other, the worst first, until each is
// within `chi2` of where the rest of it expects it. Then each of the younger ones, the oldest
// first, by all that have been believed before. What begins to move is never contradicted by the
// younger ones beside it, whose depth can be anything yet; all together they would contradict the
// old ones instead, which are known well enough for that.
class Refuter {
 public:
  explicit Refuter(int max_count);

  struct Match {
    // What is in S of its noise beyond what it scatters by in one frame, which is all that the
    // others know nothing of.
    Eigen::Matrix2d excess = Eigen::Matrix2d::Zero();
    int age = 0;  // frames
  };
  // As findConsensus(). Clears marks; none when S is not positive definite without the excess.
  void refute(const double* residuals, const double* S, int stride, std::span<const Match> matches,
              double chi2, std::vector<char>* marked);

 private:
  struct Innovations;
  // Fills order_; the number of those that are judged first.
  int sortByAge(std::span<const Match> matches, const std::vector<char>& marked);
  [[nodiscard]] bool invert(int n);
  // Clears the marks of those that the rest of the first `count` of order_ contradicts.
  void judgeTogether(int count, double chi2, std::vector<char>* marked);
  // Whether what is known of the first `count` of order_ agrees with the one after them, which is
  // known as well then.
  [[nodiscard]] bool admit(const Innovations& in, int count, double chi2);
  void leaveOut(int n, int i);
  [[nodiscard]] double* row(int i) {
    return information_.data() + static_cast<std::ptrdiff_t>(i) * stride_;
  }

  int stride_;
  std::vector<int> order_;  // matches that are looked at, the oldest first
  // Of the innovations in that order, zero where one is left out.
  std::vector<double> information_;  // n x n
  std::vector<double> weighted_;     // information times residuals
  std::vector<char> out_;
  std::vector<Eigen::Vector2d> common_;  // covariance of one with those before
  std::vector<Eigen::Vector2d> gain_;
};

}  // namespace waymark::slam
