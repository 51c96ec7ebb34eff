#include "slam/natural/pictures/picture_relocalizer.h"

#include <algorithm>
#include <utility>

#include "slam/geometry/turned_covariance.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

std::vector<NaturalMarker> withoutPoses(std::vector<PosedNaturalMarker>* pictures) {
  std::vector<NaturalMarker> markers;
  markers.reserve(pictures->size());
  for (PosedNaturalMarker& picture : *pictures) markers.push_back(std::move(picture.marker));
  return markers;
}

}  // namespace

std::string PictureRelocalizerOptions::invalidReason() const {
  return firstReason(
      {firstUnmet({
           {min_ambiguity_ratio >= 1.0, "the ratio of a picture's two poses is 1 at least"},
       }),
       nearby.invalidReason(), finder.invalidReason()});
}

LateResult cameraInPicture(const Transform& T_c_m, const Matrix6d& covariance) {
  LateResult result;
  result.T_m_c = T_c_m.inverse();
  result.covariance = covarianceOfInverse(T_c_m, covariance);
  return result;
}

PictureRelocalizer::PictureRelocalizer(std::vector<PosedNaturalMarker> pictures,
                                       const PictureRelocalizerOptions& options)
    : options_(options), markers_(withoutPoses(&pictures)), finder_(markers_, options.finder) {
  for (const PosedNaturalMarker& picture : pictures) {
    ids_.push_back(picture.id);
    T_w_m_.push_back(picture.T_w_m);
  }
}

void PictureRelocalizer::setPose(int picture, const std::optional<Transform>& T_w_m) {
  T_w_m_[static_cast<std::size_t>(picture)] = T_w_m;
}

// Ascending; none: all.
std::span<const int> PictureRelocalizer::candidatesFor(const std::optional<LastPlace>& last) {
  if (!last) return {};
  std::vector<int> nearby =
      nearbyPictures(T_w_m_, last->T_w_c, last->position_covariance, options_.nearby);
  if (nearby.empty()) return {};
  if (std::ranges::includes(candidates_, nearby)) return candidates_;
  // Twice as many last until the camera has moved on some way.
  NearbyPicturesOptions wider = options_.nearby;
  wider.most *= 2;
  candidates_ = nearbyPictures(T_w_m_, last->T_w_c, last->position_covariance, wider);
  return candidates_;
}

bool PictureRelocalizer::isOneOfAKind(const FoundPicture& found) {
  if (!found.alike.empty()) {
    ++counts_.alike;
  } else if (found.instances > 1) {
    ++counts_.repeated;
  } else {
    return true;
  }
  return false;
}

LateResult PictureRelocalizer::resultOf(const RelocalizationQuery& query,
                                        const FoundPicture& found) {
  LateResult result = cameraInPicture(found.alignment.T_c_p, found.alignment.covariance);
  result.sequence = query.time.sequence;
  result.generation = query.generation;
  result.landmark = ids_[static_cast<std::size_t>(found.picture)];
  if (!found.other_T_c_p) return result;
  const LateResult other = cameraInPicture(*found.other_T_c_p, found.other_covariance);
  result.other = LateResult::OtherPose{other.T_m_c, other.covariance};
  result.ambiguity_ratio = found.ambiguity_ratio;
  result.decided = found.ambiguity_ratio >= options_.min_ambiguity_ratio;
  if (!result.decided) ++counts_.ambiguous;
  return result;
}

std::span<const LateResult> PictureRelocalizer::locate(const RelocalizationQuery& query,
                                                       const CameraModel& camera) {
  ++counts_.searches;
  results_.clear();
  const PictureSearch search = finder_.find(query.image, camera, candidatesFor(query.last));
  counts_.not_verified += static_cast<std::uint64_t>(search.proposed) - search.found.size();
  for (const FoundPicture& found : search.found) {
    if (isOneOfAKind(found)) results_.push_back(resultOf(query, found));
  }
  counts_.located += results_.size();
  return results_;
}

}  // namespace waymark::slam
