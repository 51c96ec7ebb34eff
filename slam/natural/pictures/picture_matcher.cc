#include "slam/natural/pictures/picture_matcher.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>
#include <set>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "base/split_mix.h"
#include "slam/geometry/homography.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

// A match as geometry has it.
struct PointPair {
  Eigen::Vector2d on_print;   // metres
  double print_size;          // metres
  Eigen::Vector2d print_way;  // unit length
  Eigen::Vector2d in_image;   // normalized
  double image_size;          // normalized
  Eigen::Vector2d image_way;  // unit length
  double tolerance2;          // squared, normalized
  int place;                  // among the matches
};

std::vector<PointPair> pairsOf(const NaturalMarker& marker, std::span<const ImageFeature> image,
                               std::span<const PictureFeatureMatch> matches, double focal_px,
                               const PictureMatcherOptions& options) {
  std::vector<PointPair> pairs;
  pairs.reserve(matches.size());
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const auto& seen = image[static_cast<std::size_t>(matches[i].image_feature)];
    const auto known = static_cast<std::size_t>(matches[i].picture_feature);
    const Feature& feature = marker.features().features[known];
    const double tolerance =
        options.inlier_px / focal_px + options.inlier_share_of_size * seen.size;
    pairs.push_back({marker.featurePoint(known),
                     feature.size_px * marker.pixel_m(),
                     {std::cos(feature.angle_rad), -std::sin(feature.angle_rad)},
                     seen.normalized,
                     seen.size,
                     seen.direction,
                     tolerance * tolerance,
                     static_cast<int>(i)});
  }
  return pairs;
}

// d (H x) / d x.
Eigen::Matrix2d derivative(const Eigen::Matrix3d& H, const Eigen::Vector2d& x) {
  const Eigen::Vector3d h = H * x.homogeneous();
  const Eigen::Vector2d y = h.head<2>() / h.z();
  return (H.topLeftCorner<2, 2>() - y * H.row(2).head<2>()) / h.z();
}

// In front of the camera, where it was seen, and as large and turned as it was seen.
bool agrees(const Eigen::Matrix3d& H, const PointPair& pair) {
  const Eigen::Vector3d h = H * pair.on_print.homogeneous();
  if (!(h.z() > 0.0)) return false;
  return (h.head<2>() / h.z() - pair.in_image).squaredNorm() < pair.tolerance2;
}

bool looksAlike(const Eigen::Matrix3d& H, const PointPair& pair,
                const PictureMatcherOptions& options) {
  const Eigen::Matrix2d J = derivative(H, pair.on_print);
  // The print's y is up, the image's is down: seen from the front, the determinant is negative.
  const double area = -J.determinant();
  if (!(area > 0.0)) return false;
  const double factor = std::sqrt(area) * pair.print_size / pair.image_size;
  if (factor > options.size_factor || factor < 1.0 / options.size_factor) return false;
  const Eigen::Vector2d way = (J * pair.print_way).normalized();
  return way.dot(pair.image_way) > std::cos(options.direction_rad);
}

// Twice the area of the triangle, relative to its longest side squared: 0 on a line.
double flatness(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  const Eigen::Vector2d u = b - a;
  const Eigen::Vector2d v = c - a;
  const double longest = std::max({u.squaredNorm(), v.squaredNorm(), (u - v).squaredNorm()});
  return longest > 0.0 ? std::abs(u.x() * v.y() - u.y() * v.x()) / longest : 0.0;
}

using Four = std::array<const PointPair*, 4>;

// Exact through four pairs. Empty for three on a line, a print seen from behind, or a place that
// the features' sizes and directions contradict.
std::optional<Eigen::Matrix3d> homographyThrough(const Four& four,
                                                 const PictureMatcherOptions& options) {
  constexpr double kFlat = 0.02;
  std::array<Eigen::Vector2d, 4> print;
  std::array<Eigen::Vector2d, 4> image;
  for (std::size_t i = 0; i < 4; ++i) {
    print[i] = four[i]->on_print;
    image[i] = four[i]->in_image;
  }
  for (std::size_t i = 0; i < 4; ++i) {
    const std::size_t j = (i + 1) % 4;
    const std::size_t k = (i + 2) % 4;
    if (flatness(print[i], print[j], print[k]) < kFlat) return std::nullopt;
    if (flatness(image[i], image[j], image[k]) < kFlat) return std::nullopt;
  }
  const auto from_print = homographyFromUnitSquare(print);
  const auto from_image = homographyFromUnitSquare(image);
  if (!from_print || !from_image) return std::nullopt;
  Eigen::Matrix3d H = *from_image * from_print->inverse();
  // The print's centre is in front of the camera.
  if (!(std::abs(H(2, 2)) > 1e-9)) return std::nullopt;
  H /= H(2, 2);
  for (const PointPair* pair : four) {
    if (!((H * pair->on_print.homogeneous()).z() > 0.0)) return std::nullopt;
    if (!looksAlike(H, *pair, options)) return std::nullopt;
  }
  return H;
}

// The least squares homography with H(2,2) = 1, by the linear equations weighted with the depth of
// `start`. Empty when they are singular.
std::optional<Eigen::Matrix3d> fitHomography(const Eigen::Matrix3d& start,
                                             std::span<const PointPair* const> pairs) {
  // Coordinates of about 1 each way keep the equations well conditioned.
  double print_scale = 0.0;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  for (const PointPair* pair : pairs) {
    print_scale = std::max(print_scale, pair->on_print.norm());
    centre += pair->in_image / static_cast<double>(pairs.size());
  }
  double image_scale = 0.0;
  for (const PointPair* pair : pairs) {
    image_scale = std::max(image_scale, (pair->in_image - centre).norm());
  }
  if (!(print_scale > 0.0) || !(image_scale > 0.0)) return std::nullopt;

  using Vector8d = Eigen::Matrix<double, 8, 1>;
  Eigen::Matrix<double, 8, 8> A = Eigen::Matrix<double, 8, 8>::Zero();
  Vector8d b = Vector8d::Zero();
  for (const PointPair* pair : pairs) {
    const double depth = (start * pair->on_print.homogeneous()).z();
    const double weight = 1.0 / (depth * depth * pair->tolerance2);
    const Eigen::Vector2d p = pair->on_print / print_scale;
    const Eigen::Vector2d q = (pair->in_image - centre) / image_scale;
    for (int axis = 0; axis < 2; ++axis) {
      Vector8d row = Vector8d::Zero();
      row.segment<3>(3 * axis) << p.x(), p.y(), 1.0;
      row.tail<2>() = -q[axis] * p;
      A += weight * row * row.transpose();
      b += weight * q[axis] * row;
    }
  }
  const Eigen::LDLT<Eigen::Matrix<double, 8, 8>> factor(A);
  if (factor.info() != Eigen::Success || !(factor.rcond() > 1e-14)) return std::nullopt;
  const Vector8d h = factor.solve(b);
  Eigen::Matrix3d scaled;
  scaled << h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0;
  Eigen::Matrix3d image_from_scaled;
  image_from_scaled << image_scale, 0.0, centre.x(), 0.0, image_scale, centre.y(), 0.0, 0.0, 1.0;
  const Eigen::Vector3d print_to_scaled(1.0 / print_scale, 1.0 / print_scale, 1.0);
  Eigen::Matrix3d H = image_from_scaled * scaled * print_to_scaled.asDiagonal();
  if (!H.allFinite() || !(std::abs(H(2, 2)) > 1e-9)) return std::nullopt;
  H /= H(2, 2);
  return H;
}

std::vector<const PointPair*> inliersOf(const Eigen::Matrix3d& H, std::span<const PointPair> pairs,
                                        const PictureMatcherOptions& options) {
  std::vector<const PointPair*> inliers;
  for (const PointPair& pair : pairs) {
    if (agrees(H, pair) && looksAlike(H, pair, options)) inliers.push_back(&pair);
  }
  return inliers;
}

// The homography that most pairs agree with, fitted to them. Empty when too few do.
std::optional<Eigen::Matrix3d> bestHomography(std::span<const PointPair> pairs, std::uint64_t seed,
                                              const PictureMatcherOptions& options) {
  SplitMix64 random(seed);
  std::optional<Eigen::Matrix3d> best;
  std::size_t most = 3;
  double samples_needed = options.max_samples;
  for (int i = 0; i < options.max_samples && i < samples_needed; ++i) {
    // The strongest matches first, then more and more of them (as PROSAC).
    const std::size_t pool =
        std::min(pairs.size(), std::size_t{8} + static_cast<std::size_t>(i) / 6);
    std::array<std::size_t, 4> pick{};
    for (std::size_t k = 0; k < 4; ++k) pick[k] = static_cast<std::size_t>(random.next() % pool);
    std::sort(pick.begin(), pick.end());
    if (std::adjacent_find(pick.begin(), pick.end()) != pick.end()) continue;
    const auto H = homographyThrough(
        {&pairs[pick[0]], &pairs[pick[1]], &pairs[pick[2]], &pairs[pick[3]]}, options);
    if (!H) continue;
    std::vector<const PointPair*> inliers = inliersOf(*H, pairs, options);
    if (inliers.size() <= most) continue;
    // What four points say is loose: two rounds with all that agree.
    Eigen::Matrix3d fitted = *H;
    for (int round = 0; round < 2; ++round) {
      const auto better = fitHomography(fitted, inliers);
      if (!better) break;
      std::vector<const PointPair*> agreeing = inliersOf(*better, pairs, options);
      if (agreeing.size() < inliers.size()) break;
      fitted = *better;
      inliers = std::move(agreeing);
    }
    most = inliers.size();
    best = fitted;
    const double share = static_cast<double>(most) / static_cast<double>(pairs.size());
    const double miss = std::log(std::max(1e-12, 1.0 - std::pow(share, 4.0)));
    constexpr double kLogOfDoubt = -6.9;  // one in a thousand
    samples_needed = i + 1 + std::max(20.0, kLogOfDoubt / miss);
  }
  if (most < static_cast<std::size_t>(options.min_inliers)) return std::nullopt;
  return best;
}

// Of matches that share a feature only the strongest counts.
std::vector<PictureFeatureMatch> withoutDoubles(const std::vector<const PointPair*>& inliers,
                                                std::span<const PictureFeatureMatch> matches) {
  std::vector<PictureFeatureMatch> once;
  std::set<int> image;
  std::set<int> picture;
  for (const PointPair* pair : inliers) {
    const PictureFeatureMatch& match = matches[static_cast<std::size_t>(pair->place)];
    if (image.contains(match.image_feature) || picture.contains(match.picture_feature)) continue;
    image.insert(match.image_feature);
    picture.insert(match.picture_feature);
    once.push_back(match);
  }
  return once;
}

// Matches of what lies where the picture has been found are explained.
void dropExplained(const Eigen::Matrix3d& H, const NaturalMarker& marker,
                   std::span<const ImageFeature> image, std::vector<PictureFeatureMatch>* matches) {
  const Eigen::Matrix3d H_print_image = H.inverse();
  std::erase_if(*matches, [&](const PictureFeatureMatch& match) {
    const auto& seen = image[static_cast<std::size_t>(match.image_feature)];
    const Eigen::Vector3d p = H_print_image * seen.normalized.homogeneous();
    const Eigen::Vector2d on_print = p.head<2>() / p.z();
    return std::abs(on_print.x()) < 0.5 * marker.width_m() &&
           std::abs(on_print.y()) < 0.5 * marker.height_m();
  });
}

}  // namespace

std::string PictureMatcherOptions::invalidReason() const {
  return firstUnmet({
      {neighbours >= 2, "a feature needs at least 2 neighbours to be compared with"},
      {distance_ratio > 0.0 && distance_ratio <= 1.0, "the ratio of distances is from 0 to 1"},
      {most_candidates >= 1, "at least 1 picture must be looked at"},
      {min_votes >= 4, "a picture's place needs at least 4 votes"},
      {max_samples >= 1, "a picture's place needs at least 1 sample"},
      {min_inliers >= 5, "a picture's place needs at least 5 matches that agree"},
      {isPositive(inlier_px), "the tolerance of matches must be positive"},
      {isNotNegative(inlier_share_of_size), "the tolerance of matches must not be negative"},
      {size_factor > 1.0, "the factor between sizes must be above 1"},
      {direction_rad > 0.0 && direction_rad < std::numbers::pi,
       "the difference of directions must be from 0 to pi"},
      {most_instances >= 1, "at least 1 instance of a picture must be looked for"},
  });
}

std::vector<std::vector<PictureFeatureMatch>> matchFeatures(const FeatureSet& image,
                                                            const DescriptorIndex& index,
                                                            std::size_t pictures,
                                                            const PictureMatcherOptions& options) {
  std::vector<std::vector<PictureFeatureMatch>> matches(pictures);
  DescriptorIndex::Workspace workspace;
  std::vector<DescriptorIndex::Neighbour> neighbours;
  const auto count = static_cast<std::size_t>(options.neighbours);
  const bool squared = image.kind == FeatureKind::kSift;
  for (std::size_t i = 0; i < image.size(); ++i) {
    index.nearest(image.descriptor(i), count, &workspace, &neighbours);
    if (neighbours.size() < 2) continue;
    const double chance = std::max(1, neighbours.back().distance);
    neighbours.pop_back();
    for (const DescriptorIndex::Neighbour& neighbour : neighbours) {
      const double part = neighbour.distance / chance;
      const double ratio = squared ? std::sqrt(part) : part;
      if (ratio > options.distance_ratio) break;
      matches[static_cast<std::size_t>(neighbour.picture)].push_back(
          {static_cast<int>(i), neighbour.feature, ratio});
    }
  }
  for (std::vector<PictureFeatureMatch>& of_picture : matches) {
    std::stable_sort(of_picture.begin(), of_picture.end(),
                     [](const auto& a, const auto& b) { return a.ratio < b.ratio; });
  }
  return matches;
}

std::vector<PictureCandidate> locatePicture(int picture, const NaturalMarker& marker,
                                            std::span<const ImageFeature> image,
                                            std::vector<PictureFeatureMatch> matches,
                                            double focal_px, std::uint64_t seed,
                                            const PictureMatcherOptions& options) {
  std::vector<PictureCandidate> found;
  for (int instance = 0; instance < options.most_instances; ++instance) {
    if (matches.size() < static_cast<std::size_t>(options.min_inliers)) break;
    const std::vector<PointPair> pairs = pairsOf(marker, image, matches, focal_px, options);
    const auto H = bestHomography(pairs, seed, options);
    if (!H) break;
    PictureCandidate candidate{picture, *H, withoutDoubles(inliersOf(*H, pairs, options), matches)};
    if (candidate.inliers.size() < static_cast<std::size_t>(options.min_inliers)) break;
    const std::size_t before = matches.size();
    dropExplained(*H, marker, image, &matches);
    found.push_back(std::move(candidate));
    if (matches.size() == before) break;
  }
  return found;
}

std::vector<PictureCandidate> locatePictures(std::span<const NaturalMarker* const> pictures,
                                             std::span<const ImageFeature> image,
                                             std::vector<std::vector<PictureFeatureMatch>> matches,
                                             double focal_px,
                                             const PictureMatcherOptions& options) {
  std::vector<std::size_t> order(matches.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::erase_if(order, [&](std::size_t i) {
    return matches[i].size() < static_cast<std::size_t>(options.min_votes);
  });
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return matches[a].size() > matches[b].size();
  });
  if (order.size() > static_cast<std::size_t>(options.most_candidates)) {
    order.resize(static_cast<std::size_t>(options.most_candidates));
  }
  std::vector<PictureCandidate> found;
  for (const std::size_t i : order) {
    for (PictureCandidate& candidate : locatePicture(static_cast<int>(i), *pictures[i], image,
                                                     std::move(matches[i]), focal_px, i, options)) {
      found.push_back(std::move(candidate));
    }
  }
  std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) {
    return a.inliers.size() > b.inliers.size();
  });
  return found;
}

}  // namespace waymark::slam
