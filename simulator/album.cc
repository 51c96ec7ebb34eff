#include "simulator/album.h"

#include <algorithm>
#include <cctype>
#include <functional>
#include <iterator>
#include <set>
#include <string>
#include <system_error>
#include <utility>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "simulator/random.h"

namespace waymark::simulator {
namespace {

namespace fs = std::filesystem;

constexpr int kPictureWidth = 450;  // pixels of a part, whose shape is a poster's
constexpr int kPictureHeight = 600;
// Of a picture reduced to 300 x 400 pixels as many blocks of 16 have to have a corner of some
// contrast in them: a cloudless sky is nothing to hang.
constexpr int kFewestBlocks = 15;
constexpr double kCornerStrength = 0.002;  // smaller eigenvalue, cv::cornerMinEigenVal of bytes

bool isImageName(const fs::path& file) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension == ".jpg" || extension == ".jpeg" || extension == ".png";
}

Result<std::vector<fs::path>> imageFiles(const fs::path& directory) {
  std::error_code failed;
  std::set<fs::path> files;
  for (fs::directory_iterator it(directory, failed), end; !failed && it != end;
       it.increment(failed)) {
    if (isImageName(it->path())) files.insert(it->path());
  }
  if (failed) return Error{directory.string() + ": cannot read: " + failed.message()};
  return std::vector<fs::path>(files.begin(), files.end());
}

PosterImage pictureOf(const cv::Mat& grey) {
  const cv::Mat whole = grey.clone();  // without gaps
  return {whole.cols, whole.rows, {whole.datastart, whole.dataend}};
}

// How much there is to see: how many blocks have a corner.
int texturedBlocks(const cv::Mat& grey) {
  constexpr int kBlock = 16;
  cv::Mat small;
  cv::Mat strength;
  cv::resize(grey, small, cv::Size(300, 400), 0.0, 0.0, cv::INTER_AREA);
  cv::cornerMinEigenVal(small, strength, 5);
  int blocks = 0;
  for (int y = 0; y + kBlock <= small.rows; y += kBlock) {
    for (int x = 0; x + kBlock <= small.cols; x += kBlock) {
      double largest = 0.0;
      cv::minMaxLoc(strength(cv::Rect(x, y, kBlock, kBlock)), nullptr, &largest);
      blocks += largest > kCornerStrength;
    }
  }
  return blocks;
}

// Upright parts of an image in a grid, those with the most to see first; of an image that has no
// room for two the whole, reduced to about a part's size. None where there is too little to see.
std::vector<PosterImage> partsOf(const cv::Mat& grey) {
  const int columns = std::max(1, grey.cols / kPictureWidth);
  const int rows = std::max(1, grey.rows / kPictureHeight);
  if (columns * rows == 1) {
    if (texturedBlocks(grey) < kFewestBlocks) return {};
    const double scale = std::min(1.0, static_cast<double>(kPictureHeight) / grey.rows);
    cv::Mat reduced;
    cv::resize(grey, reduced, cv::Size(), scale, scale, cv::INTER_AREA);
    return {pictureOf(reduced)};
  }
  const cv::Size cell(grey.cols / columns, grey.rows / rows);
  const cv::Size size(std::min(cell.width, kPictureWidth), std::min(cell.height, kPictureHeight));
  std::vector<std::pair<int, cv::Rect>> parts;
  for (int i = 0; i < columns * rows; ++i) {
    const cv::Point corner(i % columns * cell.width + (cell.width - size.width) / 2,
                           i / columns * cell.height + (cell.height - size.height) / 2);
    const cv::Rect part(corner, size);
    const int blocks = texturedBlocks(grey(part));
    if (blocks >= kFewestBlocks) parts.emplace_back(blocks, part);
  }
  std::ranges::stable_sort(parts, std::greater(), [](const auto& part) { return part.first; });
  std::vector<PosterImage> pictures;
  for (const auto& [blocks, part] : parts) pictures.push_back(pictureOf(grey(part)));
  return pictures;
}

}  // namespace

Result<Album> Album::open(const fs::path& directory, std::uint64_t seed, int count) {
  Album album(seed);
  if (directory.empty() || count == 0) return album;
  Result<std::vector<fs::path>> files = imageFiles(directory);
  if (!files) return files.error();
  Random random(seed, 0x414c42554d);
  for (std::size_t i = files->size(); i > 1; --i) {
    std::swap((*files)[i - 1], (*files)[random.next() % i]);
  }
  const auto wanted = static_cast<std::size_t>(count);
  std::vector<std::vector<PosterImage>> by_rank;
  for (const fs::path& file : *files) {
    if (!by_rank.empty() && by_rank.front().size() == wanted) break;
    const cv::Mat grey = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
    if (grey.empty()) return Error{file.string() + ": is no image that can be read"};
    std::vector<PosterImage> parts = partsOf(grey);
    by_rank.resize(std::max(by_rank.size(), parts.size()));
    for (std::size_t rank = 0; rank < parts.size(); ++rank) {
      by_rank[rank].push_back(std::move(parts[rank]));
    }
  }
  for (std::vector<PosterImage>& pictures : by_rank) {
    std::ranges::move(pictures, std::back_inserter(album.photographs_));
  }
  if (album.photographs_.size() < wanted) {
    return Error{directory.string() + ": its jpg and png files give " +
                 std::to_string(album.photographs_.size()) +
                 " pictures with texture, but the scene needs " + std::to_string(count)};
  }
  album.photographs_.resize(wanted);
  return album;
}

PosterImage Album::next() {
  const std::uint64_t number = taken_++;
  if (!photographs_.empty()) return photographs_[number % photographs_.size()];
  return makePoster(Random(seed_, number).next());
}

}  // namespace waymark::simulator
