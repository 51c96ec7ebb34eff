#include "daemon/preview/preview_maker.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

namespace waymark::daemon {
namespace {

using slam::Quad;

Eigen::Vector2d centreOf(const Quad& quad) {
  return 0.25 * (quad[0] + quad[1] + quad[2] + quad[3]);
}

// Whichever way round its corners go.
bool isInside(const Quad& quad, const Eigen::Vector2d& point) {
  int left = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector2d side = quad[(i + 1) % 4] - quad[i];
    const Eigen::Vector2d to = point - quad[i];
    if (side.x() * to.y() - side.y() * to.x() > 0.0) ++left;
  }
  return left == 0 || left == 4;
}

}  // namespace

bool PreviewMaker::make(const PreviewLink::Query& frame, preview_t* message) {
  message->utime = frame.stamp.utime;
  message->monotonic_ns = frame.stamp.monotonic_ns;
  message->sequence = static_cast<std::int64_t>(frame.stamp.sequence);
  message->width = frame.image.width;
  message->height = frame.image.height;
  const PreviewImage::Reduced small = image_.reduce(frame.image);
  findRejected(frame, small.image, small.factor, message);
  return image_.encode(small.image, message);
}

void PreviewMaker::findRejected(const PreviewLink::Query& frame, const ImageView& small, int factor,
                                preview_t* message) {
  const slam::QuadScan scan = scanner_.scan(small);
  std::vector<std::size_t> order(scan.quads.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(
      order, [&](std::size_t a, std::size_t b) { return scan.promise[a] > scan.promise[b]; });
  const std::span seen = std::span(frame.markers).first(frame.seen);
  // A pixel of the small image covers `factor` of the frame's, and integers are centres.
  const auto inFrame = [&](const Eigen::Vector2d& p) -> Eigen::Vector2d {
    return factor * (p + Eigen::Vector2d::Constant(0.5)) - Eigen::Vector2d::Constant(0.5);
  };
  message->rejected_px.clear();
  for (const std::size_t i : order) {
    if (message->rejected_px.size() == options_.max_rejected) break;
    const Quad& quad = scan.quads[i];
    if ((quad[2] - quad[0]).norm() < options_.min_diagonal_px) continue;
    const Eigen::Vector2d centre = inFrame(centreOf(quad));
    // A marker itself, or cells of its code.
    if (std::ranges::any_of(seen, [&](const Quad& marker) { return isInside(marker, centre); })) {
      continue;
    }
    std::vector<std::vector<float>>& corners = message->rejected_px.emplace_back();
    for (const Eigen::Vector2d& corner : quad) {
      const Eigen::Vector2f at = inFrame(corner).cast<float>();
      corners.push_back({at.x(), at.y()});
    }
  }
  message->rejected_count = static_cast<std::int32_t>(message->rejected_px.size());
}

}  // namespace waymark::daemon
