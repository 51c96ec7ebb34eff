// The natural markers of a file, with their pictures read and their features at hand.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "base/result.h"
#include "io/pictures/natural_marker_file.h"
#include "slam/map/picture_print.h"
#include "slam/natural/pictures/alike_pictures.h"
#include "slam/natural/pictures/natural_marker.h"

namespace waymark::io {

struct NaturalPicture {
  slam::NaturalMarker marker;
  std::uint64_t key = 0;  // of the image: two with one key are the same picture
  std::string note;       // what users should know: that it was reduced; usually empty
};

struct NaturalMarkerSet {
  std::vector<NaturalMarkerEntry> entries;
  std::vector<slam::NaturalMarker> markers;  // one for each entry
  std::vector<std::uint64_t> keys;           // the same, as NaturalPicture's
  // What users should know, a line each: pictures that were reduced.
  std::vector<std::string> notes;
  std::vector<slam::AlikePictures> alike;  // of all markers
  int computed = 0;                        // features that were not in the cache
};

// One picture of a file. The Error is one line: it names the picture and what is wrong with it.
[[nodiscard]] Result<NaturalPicture> readNaturalMarker(
    const std::filesystem::path& image, double width_m, double height_m,
    const slam::NaturalMarkerOptions& options = {});

// The Error is one line: FILE, the marker, its image, and what is wrong with it (cannot be read,
// uniform, self-similar, too small, the same picture as another one's). Features come from the
// cache beside the file where it has them, and so does what looks alike where it has exactly these
// pictures; a new cache is written where it can be.
[[nodiscard]] Result<NaturalMarkerSet> readNaturalMarkers(
    const std::filesystem::path& file, const slam::NaturalMarkerOptions& options = {});
// The same of entries that stand in another kind of file: their images count from where it is.
[[nodiscard]] Result<NaturalMarkerSet> readNaturalMarkers(
    std::vector<NaturalMarkerEntry> entries, const std::filesystem::path& file,
    const slam::NaturalMarkerOptions& options = {});

// One line for who starts with them: that some look alike, of which none is used where the image
// does not tell which it is. Empty when none do.
[[nodiscard]] std::string alikeNote(const NaturalMarkerSet& set, const std::filesystem::path& file);

// What the SLAM is told of them, and what its relocalizer looks for.
[[nodiscard]] std::vector<slam::PicturePrint> printsOf(const NaturalMarkerSet& set);
[[nodiscard]] std::vector<slam::PosedNaturalMarker> picturesOf(NaturalMarkerSet set);

}  // namespace waymark::io
