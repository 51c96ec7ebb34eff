#include "slam/natural/pictures/picture_finder.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "slam/geometry/two_hypotheses.h"
#include "slam/natural/pictures/picture_pose.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

DescriptorIndex indexOf(std::span<const NaturalMarker> markers, std::span<const int> subset,
                        const DescriptorIndexOptions& options) {
  std::vector<const FeatureSet*> sets(markers.size(), nullptr);
  for (const int i : subset) {
    const auto place = static_cast<std::size_t>(i);
    sets[place] = &markers[place].features();
  }
  return DescriptorIndex(sets, options);
}

// From the print's normal, radians.
double tiltOf(const Transform& T_c_p) {
  const double cosine = -T_c_p.R.col(2).dot(T_c_p.p.normalized());
  return std::acos(std::clamp(cosine, -1.0, 1.0));
}

}  // namespace

std::string PictureFinderOptions::invalidReason() const {
  return firstReason({firstUnmet({
                          {max_image_features >= 10, "an image needs at least 10 features"},
                          {isShare(min_correlation) && isShare(min_block_correlation),
                           "the least correlation is from 0 to 1"},
                          {isShare(whole_share), "the share of a whole picture is from 0 to 1"},
                          {isShare(min_agreeing_share), "the share that agrees is from 0 to 1"},
                          {min_agreeing_blocks >= 1, "at least 1 block of a picture must agree"},
                          {max_tilt_rad > 0.0 && max_tilt_rad < 0.5 * std::numbers::pi,
                           "the tilt of a picture is below a right angle"},
                          {isNotNegative(other_rotation_rad), "the turn must not be negative"},
                          {isPositive(evidence_floor), "the evidence's floor must be positive"},
                          {isPositive(refuting_evidence), "what refutes must be positive"},
                      }),
                      index.invalidReason(), features.invalidReason(), matcher.invalidReason(),
                      alignment.invalidReason()});
}

PictureFinder::PictureFinder(std::span<const NaturalMarker> markers,
                             const PictureFinderOptions& options)
    : markers_(markers), options_(options) {
  std::vector<int> every(markers.size());
  for (std::size_t i = 0; i < every.size(); ++i) every[i] = static_cast<int>(i);
  all_ = indexOf(markers_, every, options_.index);
}

void PictureFinder::takeSubset(std::span<const int> candidates) {
  if (std::equal(candidates.begin(), candidates.end(), subset_.begin(), subset_.end())) return;
  subset_.assign(candidates.begin(), candidates.end());
  some_ = indexOf(markers_, subset_, options_.index);
}

// Features outside the lens's range are left out of both.
std::vector<ImageFeature> PictureFinder::undistorted(const FeatureSet& features,
                                                     const CameraModel& camera,
                                                     FeatureSet* kept) const {
  std::vector<ImageFeature> result;
  kept->kind = features.kind;
  kept->descriptor_bytes = features.descriptor_bytes;
  for (std::size_t i = 0; i < features.size(); ++i) {
    const Feature& feature = features.features[i];
    const auto normalized = camera.undistort({feature.x_px, feature.y_px});
    if (!normalized) continue;
    Eigen::Matrix2d J;
    (void)camera.distort(*normalized, &J);
    const Eigen::Matrix2d J_inverse = J.inverse();
    const Eigen::Vector2d way(std::cos(feature.angle_rad), std::sin(feature.angle_rad));
    result.push_back({*normalized, feature.size_px * std::sqrt(std::abs(J_inverse.determinant())),
                      (J_inverse * way).normalized()});
    kept->add(feature, features.descriptor(i));
  }
  return result;
}

bool PictureFinder::looksRight(const PictureAlignment& a) const {
  const bool whole = a.agreeing_share >= options_.whole_share;
  return a.correlation >= options_.min_correlation &&
         (whole || a.block_correlation >= options_.min_block_correlation) &&
         a.agreeing_share >= options_.min_agreeing_share &&
         a.agreeingBlocks() >= options_.min_agreeing_blocks - 0.5 &&
         tiltOf(a.T_c_p) <= options_.max_tilt_rad;
}

// The mirrored pose, fitted to the image like the first one; the better of the two is kept.
void PictureFinder::addRival(const NaturalMarker& marker, const GreyPyramid& image,
                             FoundPicture* found) {
  const double size_m = std::sqrt(marker.width_m() * marker.height_m());
  const auto start = mirroredPose(found->alignment.T_c_p, size_m, rays_->camera().focalLength());
  if (!start || !isAnotherPose(*start, found->alignment.T_c_p, options_.other_rotation_rad)) return;
  auto rival = alignPicture(marker, image, *start, &*rays_, options_.alignment);
  if (!rival || !looksRight(*rival)) return;
  if (!isAnotherPose(rival->T_c_p, found->alignment.T_c_p, options_.other_rotation_rad)) return;
  if (rival->cut_square < found->alignment.cut_square) std::swap(*rival, found->alignment);
  const double evidence =
      evidenceAgainstPose(marker, rays_->camera(), *rival, found->alignment, options_.alignment);
  constexpr double kExpected = 2.0;  // of the right pose: four corners less six unknowns
  const double floor = kExpected + options_.evidence_floor;
  found->other_T_c_p = rival->T_c_p;
  found->other_covariance = rival->covariance;
  found->ambiguity_ratio = (evidence + floor) / floor;
}

std::optional<FoundPicture> PictureFinder::verified(const PictureCandidate& candidate,
                                                    std::span<const ImageFeature> features,
                                                    const GreyPyramid& image,
                                                    PictureSearch* search) {
  const NaturalMarker& marker = markers_[static_cast<std::size_t>(candidate.picture)];
  const auto start = poseFromMatches(candidate, marker, features, rays_->camera().focalLength());
  if (!start) {
    ++search->unaligned;
    return std::nullopt;
  }
  const auto alignment = alignPicture(marker, image, *start, &*rays_, options_.alignment);
  if (!alignment) {
    ++search->unaligned;
    return std::nullopt;
  }
  if (!looksRight(*alignment)) {
    ++search->refused;
    return std::nullopt;
  }
  FoundPicture found;
  found.picture = candidate.picture;
  found.alignment = *alignment;
  found.matches = static_cast<int>(candidate.inliers.size());
  addRival(marker, image, &found);
  return found;
}

// Each one's centre lies on the other, and neither is much larger.
bool PictureFinder::sharePlace(const FoundPicture& a, const FoundPicture& b) const {
  const auto centreOn = [&](const FoundPicture& of, const FoundPicture& on) {
    const NaturalMarker& marker = markers_[static_cast<std::size_t>(on.picture)];
    const Transform T_p_c = on.alignment.T_c_p.inverse();
    const Eigen::Vector3d way = T_p_c.R * of.alignment.T_c_p.p;
    const Eigen::Vector3d hit = T_p_c.p - way * (T_p_c.p.z() / way.z());
    return std::abs(hit.x()) < 0.5 * marker.width_m() &&
           std::abs(hit.y()) < 0.5 * marker.height_m();
  };
  const auto area = [&](const FoundPicture& of) {
    return coveredArea_px(markers_[static_cast<std::size_t>(of.picture)], of.alignment.T_c_p,
                          rays_->camera());
  };
  const double ratio = area(a) / std::max(1.0, area(b));
  return ratio > 0.5 && ratio < 2.0 && centreOn(a, b) && centreOn(b, a);
}

// Of pictures in one place the refuted ones go, and those that are left are told as alike.
void PictureFinder::settleRivals(PictureSearch* search) const {
  std::vector<FoundPicture>& found = search->found;
  std::vector<bool> refuted(found.size(), false);
  for (std::size_t i = 0; i < found.size(); ++i) {
    for (std::size_t k = i + 1; k < found.size(); ++k) {
      if (refuted[i] || refuted[k] || !sharePlace(found[i], found[k])) continue;
      const bool first = found[i].alignment.cut_square <= found[k].alignment.cut_square;
      const FoundPicture& best = first ? found[i] : found[k];
      const FoundPicture& rival = first ? found[k] : found[i];
      const double evidence = evidenceAgainst(rival.alignment, best.alignment, options_.alignment);
      if (found[i].picture == found[k].picture || evidence > options_.refuting_evidence) {
        refuted[first ? k : i] = true;
      } else {
        found[i].alike.push_back(found[k].picture);
        found[k].alike.push_back(found[i].picture);
      }
    }
  }
  std::vector<FoundPicture> left;
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (refuted[i]) ++search->refuted;
    if (!refuted[i]) left.push_back(std::move(found[i]));
  }
  for (FoundPicture& one : left) {
    one.instances =
        static_cast<int>(std::count_if(left.begin(), left.end(), [&](const FoundPicture& other) {
          return other.picture == one.picture;
        }));
  }
  found = std::move(left);
}

PictureSearch PictureFinder::find(ImageView image, const CameraModel& camera,
                                  std::span<const int> candidates) {
  if (!rays_ || rays_->camera().calibration() != camera.calibration()) {
    rays_.emplace(camera);
  }
  takeSubset(candidates);
  const DescriptorIndex& index = candidates.empty() ? all_ : some_;
  PictureSearch search;
  const FeatureSet seen = extractFeatures(
      image, static_cast<std::size_t>(options_.max_image_features), options_.features);
  search.image_features = static_cast<int>(seen.size());
  if (seen.size() == 0 || index.size() == 0) return search;
  FeatureSet kept;
  const std::vector<ImageFeature> features = undistorted(seen, camera, &kept);
  std::vector<const NaturalMarker*> pictures;
  for (const NaturalMarker& marker : markers_) pictures.push_back(&marker);
  const std::vector<PictureCandidate> places = locatePictures(
      pictures, features, matchFeatures(kept, index, markers_.size(), options_.matcher),
      camera.focalLength(), options_.matcher);
  search.proposed = static_cast<int>(places.size());
  if (places.empty()) return search;
  constexpr int kSmallestLevel_px = 40;
  const GreyPyramid pyramid(image, kSmallestLevel_px);
  for (const PictureCandidate& place : places) {
    if (auto found = verified(place, features, pyramid, &search)) {
      search.found.push_back(std::move(*found));
    }
  }
  settleRivals(&search);
  return search;
}

}  // namespace waymark::slam
