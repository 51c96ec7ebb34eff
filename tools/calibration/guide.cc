#include "tools/calibration/guide.h"

#include <algorithm>
#include <cmath>

#include "tools/calibration/board_pose.h"

namespace waymark::calibration {

Guide::Guide(const Board& board, int width, int height, const GuideOptions& options)
    : board_(board),
      camera_(roughCalibration(width, height)),
      options_(options),
      // Nobody has seen it yet.
      frames_without_(options.patience_frames) {}

void Guide::add(const BoardView* board_view) {
  if (board_view == nullptr) {
    ++frames_without_;
    return;
  }
  frames_without_ = 0;
  blur_px_ = board_view->blur_px;
  const auto pose = boardPose(board_.points(), board_view->points, camera_);
  if (!pose) return;
  // Whichever way round the board is held: its normal towards the camera, seen from there.
  Eigen::Vector3d normal = pose->T_c_b.R.col(2);
  if (normal.z() > 0.0) normal = -normal;
  // One that points to the left has the left side farther away.
  const double aslant = std::atan2(normal.x(), -normal.z());
  const double upward = std::atan2(normal.y(), -normal.z());
  const auto note = [&](Side side, double tilt_rad) {
    tilt_rad_[side] = std::max(tilt_rad_[side], tilt_rad);
  };
  note(kLeft, -aslant);
  note(kRight, aslant);
  note(kTop, -upward);
  note(kBottom, upward);
}

std::string Guide::missingTilts() const {
  static constexpr std::array<const char*, kSides> kNames = {"left", "right", "top", "bottom"};
  std::string names;
  for (std::size_t side = 0; side < kSides; ++side) {
    if (tilt_rad_[side] >= options_.good_tilt_rad) continue;
    names += names.empty() ? "" : ", ";
    names += kNames[side];
  }
  return names;
}

Advice Guide::advice(const ViewCollector& collected) const {
  const std::string places = collected.coverage().missing();
  const std::string tilts = missingTilts();
  const bool enough = places.empty() && tilts.empty() && collected.count() >= options_.good_views;
  if (enough) return {"That is enough: Ctrl-C ends it, and the camera is calculated", true};
  if (frames_without_ >= options_.patience_frames) {
    return {"Show the board: it is not found in the image"};
  }
  if (blur_px_ && *blur_px_ > collected.worstBlur()) {
    return {"Hold it still, or give it more light: it is blurred"};
  }
  if (!places.empty()) return {"Bring it there in the image: " + places};
  if (!tilts.empty()) return {"Tilt it, so that this side of it is farther away: " + tilts};
  return {"A few more views, nearer and farther, turned and tilted"};
}

}  // namespace waymark::calibration
