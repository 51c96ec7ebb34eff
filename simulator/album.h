// The pictures that hang in a scene: photographs of a directory, or posters made up from a seed.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "base/result.h"
#include "simulator/poster.h"

namespace waymark::simulator {

class Album {
 public:
  // With `count` photographs from the directory's own jpg and png files, or without limit from
  // nowhere when it is empty. Which ones, and in what order, is decided by the files' names and the
  // seed. A large file has room for several pictures: the best part of each file comes first, then
  // the second best of each, and so on; parts without texture are left out. The Error is one line:
  // the directory, and that it cannot be read or has too few; or the file that is no image.
  [[nodiscard]] static Result<Album> open(const std::filesystem::path& directory,
                                          std::uint64_t seed, int count);

  // The next one, in grey and upright; photographs begin again after the last.
  [[nodiscard]] PosterImage next();

 private:
  explicit Album(std::uint64_t seed) : seed_(seed) {}

  std::uint64_t seed_;
  std::uint64_t taken_ = 0;
  std::vector<PosterImage> photographs_;  // empty: posters
};

}  // namespace waymark::simulator
