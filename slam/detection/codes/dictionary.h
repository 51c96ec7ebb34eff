// Marker dictionaries: which codes exist, what they look like, and which one was read.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace waymark::slam {

// A family of square markers: a black border one cell wide around side x side code cells.
//
// Codes are row-major from the top-left cell of the upright print, most significant bit first,
// 1 = white; side * side bits are used. Upright is each family's own: AprilTag families as the
// AprilTag library draws them, the others as OpenCV and ArUco draw them.
class Dictionary {
 public:
  struct Match {
    int id = -1;
    // Clockwise quarter turns that bring the upright code onto the code as read: the corner read
    // first (top-left of the reading) is corner number (4 - rotation) % 4 of the upright marker.
    int rotation = 0;
    int hamming = 0;  // wrong bits
  };

  // NAME is one of names(). Empty for any other.
  [[nodiscard]] static std::optional<Dictionary> byName(std::string_view name);
  // Every dictionary there is, e.g. "APRILTAG_36h11", "4X4_50".
  [[nodiscard]] static std::vector<std::string> names();

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] int side() const { return side_; }       // code cells along a side
  [[nodiscard]] int cells() const { return side_ + 2; }  // with the border
  [[nodiscard]] int size() const { return static_cast<int>(codes_.size()); }
  [[nodiscard]] std::uint64_t code(int id) const { return codes_[static_cast<std::size_t>(id)]; }
  // Smallest number of differing bits between any two codes, over all four rotations.
  [[nodiscard]] int minDistance() const { return min_distance_; }

  // Is the cell white? row and column count from the top-left border cell, 0 .. cells() - 1; the
  // border is black.
  [[nodiscard]] bool white(int id, int row, int column) const;

  // The code nearest to `code`, at most max_hamming bits away. Ties have no answer. About 1 us.
  [[nodiscard]] std::optional<Match> identify(std::uint64_t code, int max_hamming) const;

  // How many bits the nearest of all codes is away.
  [[nodiscard]] int distanceTo(std::uint64_t code) const;

  // The code as seen after the marker is turned by a quarter clockwise.
  [[nodiscard]] static std::uint64_t rotateClockwise(std::uint64_t code, int side);

 private:
  Dictionary(std::string name, int side, std::vector<std::uint64_t> codes);

  struct Entry {
    int id;
    int rotation;
  };

  std::string name_;
  int side_ = 0;
  int min_distance_ = 0;
  std::vector<std::uint64_t> codes_;
  // All four rotations, sorted by code; and of each whose it is.
  std::vector<std::uint64_t> turned_codes_;
  std::vector<Entry> entries_;
};

// Corners or sides as found, turned so that the first is the print's top-left or top. rotation: a
// Match's.
template <typename T>
[[nodiscard]] std::array<T, 4> turnedUpright(std::array<T, 4> found, int rotation) {
  std::rotate(found.begin(), found.begin() + rotation, found.end());
  return found;
}

}  // namespace waymark::slam
