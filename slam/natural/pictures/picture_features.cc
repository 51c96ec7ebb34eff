#include "slam/natural/pictures/picture_features.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>
#include <numeric>

#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>

#include "base/vectorized.h"
#include "slam/natural/pictures/opencv_view.h"
#include "slam/option_checks.h"

namespace waymark::slam {
namespace {

cv::Ptr<cv::Feature2D> makeDetector(const FeatureOptions& options, std::size_t most) {
  constexpr double kSiftEdge = 12.0;   // ratio of curvatures beyond which a feature is an edge
  constexpr double kSiftSigma = 1.6;   // of the first octave
  constexpr int kSiftLayers = 3;       // per octave
  constexpr int kBriskThreshold = 20;  // grey levels
  constexpr int kOrbFeatures = 3000;   // before the choice by octave
  switch (options.kind) {
    case FeatureKind::kBrisk:
      return cv::BRISK::create(kBriskThreshold);
    case FeatureKind::kAkaze:
      return cv::AKAZE::create();
    case FeatureKind::kOrb:
      return cv::ORB::create(kOrbFeatures);
    case FeatureKind::kSift:
      break;
  }
  // The choice by octave is made among twice as many: a descriptor takes 10 us.
  return cv::SIFT::create(static_cast<int>(2 * most), kSiftLayers, options.sift_contrast, kSiftEdge,
                          kSiftSigma, CV_8U);
}

// Features of about the same size: each bucket is twice as large as the one before.
int octaveOf(const cv::KeyPoint& point) {
  return static_cast<int>(std::floor(std::log2(std::max(point.size, 1.0F))));
}

// Strongest first; equal ones in an order that nothing but the image decides.
bool stronger(const cv::KeyPoint& a, const cv::KeyPoint& b) {
  if (a.response != b.response) return a.response > b.response;
  if (a.pt.y != b.pt.y) return a.pt.y < b.pt.y;
  if (a.pt.x != b.pt.x) return a.pt.x < b.pt.x;
  if (a.size != b.size) return a.size < b.size;
  return a.angle < b.angle;
}

// Which to keep. Half of the places go to the largest features, the strongest of an octave first;
// the other half to the strongest of what is left.
std::vector<std::size_t> chosen(const std::vector<cv::KeyPoint>& points, std::size_t most) {
  std::vector<std::size_t> order(points.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto by_strength = [&](std::size_t a, std::size_t b) {
    return stronger(points[a], points[b]);
  };
  std::sort(order.begin(), order.end(), by_strength);
  if (order.size() <= most) return order;
  const auto half = order.begin() + static_cast<std::ptrdiff_t>(most / 2);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return octaveOf(points[a]) > octaveOf(points[b]);
  });
  std::sort(half, order.end(), by_strength);
  order.resize(most);
  return order;
}

WAYMARK_VECTORIZED
int squaredDistance(const std::uint8_t* a, const std::uint8_t* b, int bytes) {
  int sum = 0;
  for (int i = 0; i < bytes; ++i) {
    const int difference = static_cast<int>(a[i]) - static_cast<int>(b[i]);
    sum += difference * difference;
  }
  return sum;
}

int differingBits(const std::uint8_t* a, const std::uint8_t* b, int bytes) {
  int sum = 0;
  int i = 0;
  for (; i + 8 <= bytes; i += 8) {
    std::uint64_t u = 0;
    std::uint64_t v = 0;
    std::memcpy(&u, a + i, 8);
    std::memcpy(&v, b + i, 8);
    sum += std::popcount(u ^ v);
  }
  for (; i < bytes; ++i) sum += std::popcount(static_cast<unsigned>(a[i] ^ b[i]));
  return sum;
}

}  // namespace

std::string FeatureOptions::invalidReason() const {
  return firstUnmet({{isPositive(sift_contrast), "the contrast of features must be positive"}});
}

FeatureSet extractFeatures(ImageView image, std::size_t most, const FeatureOptions& options) {
  const cv::Ptr<cv::Feature2D> detector = makeDetector(options, most);
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;
  detector->detectAndCompute(matOf(image), cv::noArray(), points, descriptors);

  FeatureSet set;
  set.kind = options.kind;
  set.descriptor_bytes = descriptors.cols;
  for (const std::size_t i : chosen(points, most)) {
    const cv::KeyPoint& point = points[i];
    const float angle = point.angle * std::numbers::pi_v<float> / 180.0F;
    set.add({point.pt.x, point.pt.y, point.size, angle, point.response},
            descriptors.ptr<std::uint8_t>(static_cast<int>(i)));
  }
  set.upright = set.size();
  return set;
}

int descriptorDistance(FeatureKind kind, const std::uint8_t* a, const std::uint8_t* b, int bytes) {
  return kind == FeatureKind::kSift ? squaredDistance(a, b, bytes) : differingBits(a, b, bytes);
}

}  // namespace waymark::slam
