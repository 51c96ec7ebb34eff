// Which matches of a frame belong together: the largest set that one of its members explains
// ("1-point RANSAC", Civera et al. 2010). One match and what the filter expects fix the camera well
// enough to judge the others, so that a handful of hypotheses is all there are.
#pragma once

#include <vector>

namespace waymark::slam {

// Innovations of `count` matches, two numbers each, and their covariance by rows, of which the
// lower triangle is looked at. All correlations count: after one match is believed, the others are
// expected where the filter would expect them then, to within what would still be open. Marks those
// whose squared Mahalanobis distance stays below `chi2` in the best hypothesis; at most
// `hypotheses` are tried, spread over the matches. `marked` has count entries.
void findConsensus(const double* residuals, const double* S, int stride, int count, double chi2,
                   int hypotheses, std::vector<char>* marked);

}  // namespace waymark::slam
