#include "slam/detection/codes/dictionary.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <map>
#include <tuple>
#include <utility>

#include <opencv2/aruco/dictionary.hpp>

#include "base/vectorized.h"
#include "slam/detection/codes/dictionary_aruco_mip_36h12.h"

namespace waymark::slam {
namespace {

struct OpenCvSource {
  int predefined;     // cv::aruco::PREDEFINED_DICTIONARY_NAME
  int quarter_turns;  // clockwise turns that bring OpenCV's table to the family's own upright
};

// OpenCV's AprilTag tables are not all upright as the AprilTag library prints them;
// dictionary_test.cc compares every code with that library.
const std::map<std::string, OpenCvSource, std::less<>>& openCvSources() {
  using namespace cv::aruco;  // NOLINT(google-build-using-namespace): twenty constants
  static const std::map<std::string, OpenCvSource, std::less<>> sources = {
      {"4X4_50", {DICT_4X4_50, 0}},
      {"4X4_100", {DICT_4X4_100, 0}},
      {"4X4_250", {DICT_4X4_250, 0}},
      {"4X4_1000", {DICT_4X4_1000, 0}},
      {"5X5_50", {DICT_5X5_50, 0}},
      {"5X5_100", {DICT_5X5_100, 0}},
      {"5X5_250", {DICT_5X5_250, 0}},
      {"5X5_1000", {DICT_5X5_1000, 0}},
      {"6X6_50", {DICT_6X6_50, 0}},
      {"6X6_100", {DICT_6X6_100, 0}},
      {"6X6_250", {DICT_6X6_250, 0}},
      {"6X6_1000", {DICT_6X6_1000, 0}},
      {"7X7_50", {DICT_7X7_50, 0}},
      {"7X7_100", {DICT_7X7_100, 0}},
      {"7X7_250", {DICT_7X7_250, 0}},
      {"7X7_1000", {DICT_7X7_1000, 0}},
      {"ARUCO_ORIGINAL", {DICT_ARUCO_ORIGINAL, 0}},
      {"APRILTAG_16h5", {DICT_APRILTAG_16h5, 2}},
      {"APRILTAG_25h9", {DICT_APRILTAG_25h9, 2}},
      {"APRILTAG_36h11", {DICT_APRILTAG_36h11, 2}},
  };
  return sources;
}

constexpr std::string_view kArucoMip = "ARUCO_MIP_36h12";

std::vector<std::uint64_t> codesFromOpenCv(const OpenCvSource& source, int* side) {
  const cv::Ptr<cv::aruco::Dictionary> table =
      cv::aruco::getPredefinedDictionary(source.predefined);
  *side = table->markerSize;
  std::vector<std::uint64_t> codes;
  codes.reserve(static_cast<std::size_t>(table->bytesList.rows));
  for (int id = 0; id < table->bytesList.rows; ++id) {
    const cv::Mat bits =
        cv::aruco::Dictionary::getBitsFromByteList(table->bytesList.rowRange(id, id + 1), *side);
    std::uint64_t code = 0;
    for (int r = 0; r < *side; ++r) {
      for (int c = 0; c < *side; ++c) code = (code << 1) | (bits.at<std::uint8_t>(r, c) & 1U);
    }
    for (int k = 0; k < source.quarter_turns; ++k) code = Dictionary::rotateClockwise(code, *side);
    codes.push_back(code);
  }
  return codes;
}

// Of bits, to the nearest of so many codes; not above `most`.
WAYMARK_VECTORIZED int leastDistance(const std::uint64_t* codes, std::size_t count,
                                     std::uint64_t code, int most) {
  int least = most;
  for (std::size_t i = 0; i < count; ++i) least = std::min(least, std::popcount(codes[i] ^ code));
  return least;
}

}  // namespace

std::uint64_t Dictionary::rotateClockwise(std::uint64_t code, int side) {
  std::uint64_t turned = 0;
  for (int r = 0; r < side; ++r) {
    for (int c = 0; c < side; ++c) {
      const int from = (side - 1 - c) * side + r;  // row side-1-c, column r
      turned = (turned << 1) | ((code >> (side * side - 1 - from)) & 1U);
    }
  }
  return turned;
}

Dictionary::Dictionary(std::string name, int side, std::vector<std::uint64_t> codes)
    : name_(std::move(name)), side_(side), codes_(std::move(codes)) {
  std::vector<std::tuple<std::uint64_t, int, int>> turned;  // code, id, rotation
  turned.reserve(codes_.size() * 4);
  for (int id = 0; id < size(); ++id) {
    std::uint64_t code = codes_[static_cast<std::size_t>(id)];
    for (int rotation = 0; rotation < 4; ++rotation) {
      turned.emplace_back(code, id, rotation);
      code = rotateClockwise(code, side_);
    }
  }
  min_distance_ = side_ * side_;
  for (std::size_t a = 0; a < turned.size(); a += 4) {  // rotation 0 of each code
    for (std::size_t b = a + 1; b < turned.size(); ++b) {
      min_distance_ =
          std::min(min_distance_, std::popcount(std::get<0>(turned[a]) ^ std::get<0>(turned[b])));
    }
  }
  std::ranges::sort(turned);
  for (const auto& [code, id, rotation] : turned) {
    turned_codes_.push_back(code);
    entries_.push_back({id, rotation});
  }
}

std::optional<Dictionary> Dictionary::byName(std::string_view name) {
  if (name == kArucoMip) {
    return Dictionary(std::string(name), 6, {kArucoMip36h12.begin(), kArucoMip36h12.end()});
  }
  const auto found = openCvSources().find(name);
  if (found == openCvSources().end()) return std::nullopt;
  int side = 0;
  std::vector<std::uint64_t> codes = codesFromOpenCv(found->second, &side);
  return Dictionary(std::string(name), side, std::move(codes));
}

std::vector<std::string> Dictionary::names() {
  std::vector<std::string> all{std::string(kArucoMip)};
  for (const auto& [name, source] : openCvSources()) all.push_back(name);
  std::sort(all.begin(), all.end());
  return all;
}

bool Dictionary::white(int id, int row, int column) const {
  const int r = row - 1;
  const int c = column - 1;
  if (r < 0 || c < 0 || r >= side_ || c >= side_) return false;
  return ((code(id) >> (side_ * side_ - 1 - (r * side_ + c))) & 1U) != 0;
}

std::optional<Dictionary::Match> Dictionary::identify(std::uint64_t code, int max_hamming) const {
  const auto matchAt = [this](auto place, int hamming) {
    const Entry& entry = entries_[static_cast<std::size_t>(place - turned_codes_.begin())];
    return Match{entry.id, entry.rotation, hamming};
  };
  const auto exact = std::ranges::lower_bound(turned_codes_, code);
  if (exact != turned_codes_.end() && *exact == code) return matchAt(exact, 0);
  const int least = distanceTo(code);
  if (least > max_hamming) return std::nullopt;
  const auto is_nearest = [=](std::uint64_t other) { return std::popcount(other ^ code) == least; };
  const auto nearest = std::ranges::find_if(turned_codes_, is_nearest);
  const bool tie =
      std::find_if(nearest + 1, turned_codes_.end(), is_nearest) != turned_codes_.end();
  return tie ? std::nullopt : std::optional(matchAt(nearest, least));
}

int Dictionary::distanceTo(std::uint64_t code) const {
  return leastDistance(turned_codes_.data(), turned_codes_.size(), code, side_ * side_);
}

}  // namespace waymark::slam
