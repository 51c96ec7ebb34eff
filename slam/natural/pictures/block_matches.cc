#include "slam/natural/pictures/block_matches.h"

#include <map>
#include <optional>

namespace waymark::slam {
namespace {

// The pixels of a block.
using Block = std::vector<const PhotometricPixel*>;

std::map<BlockPlace, Block> blocksOf(const std::vector<PhotometricPixel>& pixels, int block_px) {
  std::map<BlockPlace, Block> blocks;
  for (const PhotometricPixel& pixel : pixels) blocks[blockOf(pixel, block_px)].push_back(&pixel);
  return blocks;
}

// Expected against seen, moved by (dx, dy) pixels. Empty where a part is beyond the image.
PixelBlock movedBy(const Block& block, const GreyLevels& image, int dx, int dy) {
  PixelBlock sums;
  for (const PhotometricPixel* pixel : block) {
    const int x = pixel->column + dx;
    const int y = pixel->row + dy;
    if (x < 0 || y < 0 || x >= image.width || y >= image.height) return {};
    sums.add(pixel->expected, static_cast<double>(image.row(y)[x]));
  }
  return sums;
}

std::optional<Eigen::Vector2i> bestMove(const Block& block, const GreyLevels& image,
                                        const BlockMatchOptions& options) {
  std::optional<Eigen::Vector2i> best;
  double most = options.correlation;
  for (int dy = -options.reach_px; dy <= options.reach_px; ++dy) {
    for (int dx = -options.reach_px; dx <= options.reach_px; ++dx) {
      const double correlation = movedBy(block, image, dx, dy).correlation();
      if (correlation <= most) continue;
      most = correlation;
      best = Eigen::Vector2i(dx, dy);
    }
  }
  return best;
}

}  // namespace

std::vector<PrintPoint> matchBlocks(const std::vector<PhotometricPixel>& pixels,
                                    const GreyLevels& image, int level, const CameraModel& camera,
                                    const BlockMatchOptions& options) {
  std::vector<PrintPoint> matches;
  for (const auto& [place, block] : blocksOf(pixels, options.block_px)) {
    if (block.size() < kLeastBlockPixels) continue;
    if (movedBy(block, image, 0, 0).contrast() < options.contrast) continue;
    const auto move = bestMove(block, image, options);
    if (!move) continue;
    Eigen::Vector3d on_print = Eigen::Vector3d::Zero();
    Eigen::Vector2d at = Eigen::Vector2d::Zero();
    for (const PhotometricPixel* pixel : block) {
      on_print += pixel->on_print;
      at += Eigen::Vector2d(pixel->column, pixel->row);
    }
    const auto count = static_cast<double>(block.size());
    at = at / count + move->cast<double>();
    const auto normalized = camera.undistort({toFull(at.x(), level), toFull(at.y(), level)});
    if (normalized) matches.push_back({on_print / count, *normalized});
  }
  return matches;
}

}  // namespace waymark::slam
