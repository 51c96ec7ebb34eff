#include "slam/natural/pictures/natural_marker.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

cv::Mat matOf(ImageView image) {
  return {image.height, image.width, CV_8U, const_cast<std::uint8_t*>(image.data),
          static_cast<std::size_t>(image.stride)};
}

ImageView viewOf(const cv::Mat& image) {
  return {image.data, image.cols, image.rows, static_cast<std::ptrdiff_t>(image.step)};
}

// The longer side becomes at most `side_px`; each pixel the mean of what it covers.
cv::Mat reduced(const cv::Mat& image, int side_px) {
  const double scale = static_cast<double>(side_px) / std::max(image.cols, image.rows);
  if (scale >= 1.0) return image;
  const cv::Size size(std::max(1, static_cast<int>(std::lround(scale * image.cols))),
                      std::max(1, static_cast<int>(std::lround(scale * image.rows))));
  cv::Mat small;
  cv::resize(image, small, size, 0.0, 0.0, cv::INTER_AREA);
  return small;
}

double contrastOf(const cv::Mat& image) {
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(image, mean, deviation);
  return deviation[0];
}

// Features that no other place in the picture shares.
int countDistinct(const FeatureSet& set, int same_distance2) {
  if (set.kind != FeatureKind::kSift) return static_cast<int>(set.size());
  std::vector<bool> repeated(set.size(), false);
  for (std::size_t i = 0; i < set.size(); ++i) {
    for (std::size_t k = i + 1; k < set.size(); ++k) {
      if (repeated[i] && repeated[k]) continue;
      const Feature& a = set.features[i];
      const Feature& b = set.features[k];
      // One place may have several directions, or be found at two sizes.
      const float near_px = 0.5F * (a.size_px + b.size_px);
      if (std::hypot(a.x_px - b.x_px, a.y_px - b.y_px) < near_px) continue;
      if (descriptorDistance(set.kind, set.descriptor(i), set.descriptor(k),
                             set.descriptor_bytes) >= same_distance2) {
        continue;
      }
      repeated[i] = true;
      repeated[k] = true;
    }
  }
  return static_cast<int>(std::count(repeated.begin(), repeated.end(), false));
}

// Empty when the picture will do.
std::string objectionTo(const PictureQuality& quality, const NaturalMarkerOptions& options) {
  if (quality.repeatedShare() > options.max_repeated_share) {
    return "is self-similar: " + std::to_string(quality.features - quality.distinct_features) +
           " of its " + std::to_string(quality.features) + " features occur more than once in it";
  }
  if (quality.distinct_features < options.min_distinct_features) {
    return "has too little texture: " + std::to_string(quality.distinct_features) +
           " distinct features, at least " + std::to_string(options.min_distinct_features) +
           " are needed";
  }
  return {};
}

std::string objectionTo(const cv::Mat& image, double width_m, double height_m,
                        const NaturalMarkerOptions& options) {
  if (!isPositive(width_m)) return "its width must be positive, metres";
  if (!isNotNegative(height_m)) return "its height must not be negative, metres";
  if (std::min(image.cols, image.rows) < options.min_side_px) {
    return "is too small: " + sizeText(image.cols, image.rows) + " pixels, at least " +
           std::to_string(options.min_side_px) + " each way are needed";
  }
  return {};
}

}  // namespace

std::string NaturalMarkerOptions::invalidReason() const {
  return firstReason(
      {firstUnmet({
           {min_side_px >= 16, "a picture's shorter side must be at least 16 pixels"},
           {max_side_px >= min_side_px, "a picture's largest side is below its smallest"},
           {isNotNegative(min_contrast), "a picture's contrast must not be negative"},
           {feature_side_px >= min_side_px, "features need more of a picture than that"},
           {max_features >= 10, "a picture needs at least 10 features"},
           {min_distinct_features >= 0, "the number of distinct features must not be negative"},
           {isShare(max_repeated_share), "the share of repeated features must be from 0 to 1"},
           {same_feature_distance2 >= 0, "the distance of the same feature must not be negative"},
       }),
       features.invalidReason()});
}

Result<NaturalMarker> NaturalMarker::create(ImageView image, double width_m, double height_m,
                                            const NaturalMarkerOptions& options,
                                            const FeatureSet* known) {
  const cv::Mat given = matOf(image);
  if (std::string reason = objectionTo(given, width_m, height_m, options); !reason.empty()) {
    return Error{reason};
  }
  const cv::Mat picture = reduced(given, options.max_side_px);
  if (std::min(picture.cols, picture.rows) < options.min_side_px) {
    return Error{"is too narrow: " + sizeText(image.width, image.height) + " pixels"};
  }
  NaturalMarker marker;
  marker.quality_.contrast = contrastOf(picture);
  if (marker.quality_.contrast < options.min_contrast) return Error{"is a uniform picture"};
  marker.width_m_ = width_m;
  marker.height_m_ = height_m > 0.0 ? height_m : width_m * image.height / image.width;
  constexpr int kSmallestLevel_px = 8;
  marker.grey_ = GreyPyramid(viewOf(picture), kSmallestLevel_px);
  const cv::Mat for_features = reduced(picture, options.feature_side_px);
  marker.feature_width_px_ = for_features.cols;
  marker.feature_height_px_ = for_features.rows;
  marker.features_ =
      known != nullptr
          ? *known
          : extractFeatures(viewOf(for_features), static_cast<std::size_t>(options.max_features),
                            options.features);
  marker.quality_.features = static_cast<int>(marker.features_.size());
  marker.quality_.distinct_features =
      countDistinct(marker.features_, options.same_feature_distance2);
  if (std::string reason = objectionTo(marker.quality_, options); !reason.empty()) {
    return Error{reason};
  }
  return marker;
}

double NaturalMarker::featurePixel_m() const {
  return std::sqrt(width_m_ / feature_width_px_ * height_m_ / feature_height_px_);
}

Eigen::Vector2d NaturalMarker::featurePoint(std::size_t i) const {
  const Feature& feature = features_.features[i];
  return {((feature.x_px + 0.5) / feature_width_px_ - 0.5) * width_m_,
          (0.5 - (feature.y_px + 0.5) / feature_height_px_) * height_m_};
}

Eigen::Vector2d NaturalMarker::toPixel(const Eigen::Vector2d& point_m) const {
  const GreyLevels& full = grey_.level(0);
  return {(point_m.x() / width_m_ + 0.5) * full.width - 0.5,
          (0.5 - point_m.y() / height_m_) * full.height - 0.5};
}

Eigen::Vector2d NaturalMarker::pixelsPerMetre() const {
  const GreyLevels& full = grey_.level(0);
  return {full.width / width_m_, full.height / height_m_};
}

}  // namespace waymark::slam
