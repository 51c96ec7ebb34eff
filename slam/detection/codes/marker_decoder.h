// Reads the code inside a quadrilateral.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "base/image_view.h"
#include "slam/detection/codes/dictionary.h"
#include "slam/geometry/camera_model.h"

namespace waymark::slam {

struct MarkerDecoderOptions {
  // Bits of the code that may be wrong, at most; never more than the dictionary can correct. Each
  // one more finds a few dirty markers and invites many false ones.
  int max_wrong_bits = 2;
  // Cells of the black border that may read white, as a share of all of them.
  double max_wrong_border = 0.10;
  // Where corners are only good to a pixel or two, more of them do on small markers: beyond this
  // share a quad is no marker.
  double max_wrong_rough_border = 0.35;
  // Least mean difference between the border and what surrounds it, grey levels.
  double min_contrast = 10.0;
  // Least likeness of a measured marker to its print (code_likeness.h). What reads as a code and
  // was none had 0.39 to 0.56 and seldom 0.8; markers of 12 pixels in dim, blurred images 0.62.
  double min_likeness = 0.6;
  // Where the lens bends a print by less than this, a share of a cell, it is taken for straight:
  // no cell notices, and it costs less.
  double straight_bend = 0.1;
  // From this size on a cell is read at five places: their nearest pixels are all within the cell.
  // Smaller ones are read in their middle, between its pixels. Pixels.
  double large_cell_px = 5.0;
  // How far from the middle the other four are, a share of a cell: near enough that corners may be
  // off by a pixel or two.
  double sample_spread = 0.18;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// What a quadrilateral looks like.
enum class QuadContent {
  kNothing,  // no dark border on a lighter ground
  kNoCode,   // a border, but no code of the dictionary that can be read with these corners
  kMarker,
};

struct QuadReading {
  QuadContent content = QuadContent::kNothing;
  Dictionary::Match match;            // of a marker
  std::optional<std::uint64_t> code;  // as read, where the border is good enough for that
};

class MarkerDecoder {
 public:
  // Both references must outlive the decoder.
  MarkerDecoder(const CameraModel& camera, const Dictionary& dictionary,
                const MarkerDecoderOptions& options = {});

  // `corners`: normalized, clockwise in the image, starting anywhere.
  [[nodiscard]] QuadReading read(const ImageView& image,
                                 const std::array<Eigen::Vector2d, 4>& corners);
  // How much the square that was read last looks like the print of `id` (code_likeness.h).
  // variance: of the image's noise. Precondition: it read as that marker, with rotation 0.
  [[nodiscard]] double likeness(int id, double variance) const;

  [[nodiscard]] const MarkerDecoderOptions& options() const { return options_; }

 private:
  using Corners = std::array<Eigen::Vector2d, 4>;

  // Fills centres_ and large_cells_. False for a degenerate quad.
  [[nodiscard]] bool layOutCells(const Corners& corners);
  // Mean grey level of a cell; -1 when some of it is outside the image. Rows and columns count from
  // the border's; -1 and cells are the ring of light cells around it.
  [[nodiscard]] float greyOf(const ImageView& image, int row, int column) const;
  [[nodiscard]] const Eigen::Vector2f& centre(int row, int column) const {
    const int index = (row + 1) * (dictionary_.cells() + 2) + column + 1;
    return centres_[static_cast<std::size_t>(index)];
  }

  const CameraModel& camera_;
  const Dictionary& dictionary_;
  MarkerDecoderOptions options_;
  std::vector<Eigen::Vector2f> centres_;  // of the cells, pixels; with the ring, row by row
  bool large_cells_ = false;              // in this quad
  std::vector<float> levels_;             // grey levels of the cells, with the border's, row by row
};

}  // namespace waymark::slam
