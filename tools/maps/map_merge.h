// Joins two maps by the markers they share.
#pragma once

#include <string>
#include <vector>

#include "base/result.h"
#include "io/maps/map_file.h"
#include "slam/geometry/transform.h"

namespace waymark::tools {

struct MergeOptions {
  // A shared marker agrees when none of its corners is further than this from where the other map
  // has it, metres: above what maps drift over a room, below what somebody moves a marker by.
  double tolerance_m = 0.05;
  // Shared markers that must agree, and they must be more than those that do not. With one alone
  // nothing would contradict it, and a turn of half a degree is 9 cm at 10 m.
  int min_agreeing = 2;
};

struct MergeReport {
  slam::Transform T_a_b;         // of the first pieces of each that were joined
  std::vector<int> agreeing;     // ids
  std::vector<int> disagreeing;  // ids: moved between the maps, or two prints
  std::vector<int> added;        // ids of the markers that only b has a pose for
  double rms_m = 0.0;            // of the agreeing corners, before any optimization
  int pieces_joined = 0;         // of b that have become part of one of a
  int pieces_apart = 0;          // of b that share too little with any of a: pieces of their own
  int bridged = 0;               // pieces of a that b has joined to others of a
  std::vector<std::string> warnings;
};

// Adds b to a, without any change of scale: each piece of b to the first one of a that it agrees
// with, in whose world it is then, and so are those of a that agree with both. b's keyframes come
// after a's with new ids. Where a marker disagrees, a is right, and what b's keyframes saw of it is
// left out. The error says why no two pieces can be merged, and names the markers of the first two;
// *a is then unchanged.
[[nodiscard]] Result<MergeReport> mergeMaps(io::MapFile* a, const io::MapFile& b,
                                            const MergeOptions& options);

}  // namespace waymark::tools
