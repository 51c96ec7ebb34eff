// Reads the code inside a quadrilateral.
#pragma once

#include <array>
#include <optional>

#include <Eigen/Core>

#include "base/image_view.h"
#include "slam/detection/dictionary.h"
#include "slam/geometry/camera_model.h"

namespace waymark::slam {

struct MarkerDecoderOptions {
  // Bits of the code that may be wrong, at most; never more than the dictionary can correct. Each
  // one more finds a few dirty markers and invites many false ones.
  int max_wrong_bits = 2;
  // Cells of the black border that may read white, as a share of all of them.
  double max_wrong_border = 0.10;
};

class MarkerDecoder {
 public:
  // Both references must outlive the decoder.
  MarkerDecoder(const CameraModel& camera, const Dictionary& dictionary,
                const MarkerDecoderOptions& options = {});

  // `corners`: normalised, clockwise in the image, starting anywhere. black and white: the grey
  // levels of border and surroundings. Empty when it is no marker of the dictionary.
  [[nodiscard]] std::optional<Dictionary::Match> decode(
      const ImageView& image, const std::array<Eigen::Vector2d, 4>& corners, double black,
      double white) const;

 private:
  const CameraModel& camera_;
  const Dictionary& dictionary_;
  MarkerDecoderOptions options_;
};

}  // namespace waymark::slam
