#include "slam/natural/pictures/natural_marker.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include <Eigen/LU>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "slam/natural/pictures/opencv_view.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

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

// Of the first `count` features those that no other place in the picture shares.
int countDistinct(const FeatureSet& set, std::size_t count, int same_distance2) {
  if (set.kind != FeatureKind::kSift) return static_cast<int>(count);
  std::vector<bool> repeated(count, false);
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t k = i + 1; k < count; ++k) {
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

// Features of the picture as if it were turned by turn_rad and pressed together along x, that is
// tilted; as they would be in the picture.
FeatureSet tiltedFeatures(const cv::Mat& picture, double turn_rad,
                          const NaturalMarkerOptions& options) {
  const double factor = options.tilt_factor;
  const double c = std::cos(turn_rad);
  const double s = std::sin(turn_rad);
  // What the pressing leaves no room for is blurred away before, along x only.
  constexpr double kBlurPerFactor = 0.8;
  const double reach_x = 0.5 * (picture.cols * std::abs(c) + picture.rows * std::abs(s));
  const double reach_y = 0.5 * (picture.cols * std::abs(s) + picture.rows * std::abs(c));
  const Eigen::Vector2d middle(0.5 * (picture.cols - 1), 0.5 * (picture.rows - 1));
  Eigen::Matrix2d turn;
  turn << c, s, -s, c;
  const auto warp = [&](const cv::Mat& from, const Eigen::Matrix2d& A,
                        const Eigen::Vector2d& before, const cv::Size& size) {
    const Eigen::Vector2d after(0.5 * (size.width - 1), 0.5 * (size.height - 1));
    const Eigen::Vector2d shift = after - A * before;
    const cv::Mat M =
        (cv::Mat_<double>(2, 3) << A(0, 0), A(0, 1), shift.x(), A(1, 0), A(1, 1), shift.y());
    cv::Mat to;
    cv::warpAffine(from, to, M, size, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    return to;
  };
  const cv::Size turned_size(static_cast<int>(2.0 * reach_x) + 1,
                             static_cast<int>(2.0 * reach_y) + 1);
  cv::Mat turned = warp(picture, turn, middle, turned_size);
  const double blur = kBlurPerFactor * std::sqrt(factor * factor - 1.0);
  cv::GaussianBlur(turned, turned, cv::Size(0, 1), blur, 1e-3);
  const Eigen::Matrix2d press = Eigen::Vector2d(1.0 / factor, 1.0).asDiagonal();
  const cv::Size size(static_cast<int>(turned.cols / factor), turned.rows);
  const Eigen::Vector2d turned_middle(0.5 * (turned.cols - 1), 0.5 * (turned.rows - 1));
  const cv::Mat view = warp(turned, press, turned_middle, size);

  FeatureSet seen = extractFeatures(
      viewOf(view), 2 * static_cast<std::size_t>(options.max_tilted_features), options.features);
  FeatureSet kept{seen.kind, seen.descriptor_bytes, {}, {}};
  const Eigen::Matrix2d back = (press * turn).inverse();
  const Eigen::Vector2d view_middle(0.5 * (size.width - 1), 0.5 * (size.height - 1));
  for (std::size_t i = 0; i < seen.size(); ++i) {
    if (kept.size() == static_cast<std::size_t>(options.max_tilted_features)) break;
    const Feature& f = seen.features[i];
    const Eigen::Vector2d at = back * (Eigen::Vector2d(f.x_px, f.y_px) - view_middle) + middle;
    // What describes the replicated border is not of the picture.
    const double margin = 0.5 * f.size_px;
    if (at.x() < margin || at.y() < margin || at.x() > picture.cols - 1 - margin ||
        at.y() > picture.rows - 1 - margin) {
      continue;
    }
    const Eigen::Vector2d way =
        back * Eigen::Vector2d(std::cos(f.angle_rad), std::sin(f.angle_rad));
    kept.add({static_cast<float>(at.x()), static_cast<float>(at.y()),
              static_cast<float>(f.size_px * std::sqrt(back.determinant())),
              static_cast<float>(std::atan2(way.y(), way.x())), f.strength},
             seen.descriptor(i));
  }
  return kept;
}

// Of the picture as it is, then of its tilted views.
FeatureSet allFeatures(const cv::Mat& picture, const NaturalMarkerOptions& options) {
  FeatureSet all = extractFeatures(viewOf(picture), static_cast<std::size_t>(options.max_features),
                                   options.features);
  all.upright = all.size();
  for (int i = 0; i < options.tilted_views; ++i) {
    const FeatureSet tilted =
        tiltedFeatures(picture, std::numbers::pi * i / options.tilted_views, options);
    if (tilted.size() == 0 || tilted.descriptor_bytes != all.descriptor_bytes) continue;
    all.features.insert(all.features.end(), tilted.features.begin(), tilted.features.end());
    all.descriptors.insert(all.descriptors.end(), tilted.descriptors.begin(),
                           tilted.descriptors.end());
  }
  return all;
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
           {max_features >= 10, "a picture needs at least 10 features"},
           {max_tilted_features >= 0, "the number of tilted features must not be negative"},
           {tilted_views >= 0 && tilted_views <= 12, "a picture has up to 12 tilted views"},
           {tilt_factor >= 1.1 && tilt_factor <= 6.0, "a view's tilt factor is from 1.1 to 6"},
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
  marker.grey_ = PicturePyramid(viewOf(picture), kSmallestLevel_px);
  marker.features_ = known != nullptr ? *known : allFeatures(picture, options);
  marker.quality_.features = static_cast<int>(marker.features_.upright);
  marker.quality_.distinct_features =
      countDistinct(marker.features_, marker.features_.upright, options.same_feature_distance2);
  if (std::string reason = objectionTo(marker.quality_, options); !reason.empty()) {
    return Error{reason};
  }
  return marker;
}

double NaturalMarker::pixel_m() const {
  const auto& full = grey_.level(0);
  return std::sqrt(width_m_ / full.width * height_m_ / full.height);
}

Eigen::Vector2d NaturalMarker::featurePoint(std::size_t i) const {
  const Feature& feature = features_.features[i];
  const auto& full = grey_.level(0);
  return {((feature.x_px + 0.5) / full.width - 0.5) * width_m_,
          (0.5 - (feature.y_px + 0.5) / full.height) * height_m_};
}

Eigen::Vector2d NaturalMarker::toPixel(const Eigen::Vector2d& point_m) const {
  const auto& full = grey_.level(0);
  return {(point_m.x() / width_m_ + 0.5) * full.width - 0.5,
          (0.5 - point_m.y() / height_m_) * full.height - 0.5};
}

Eigen::Vector2d NaturalMarker::pixelsPerMetre() const {
  const auto& full = grey_.level(0);
  return {full.width / width_m_, full.height / height_m_};
}

}  // namespace waymark::slam
