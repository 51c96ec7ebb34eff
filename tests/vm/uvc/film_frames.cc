#include "tests/vm/uvc/film_frames.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <utility>
#include <variant>

#include <gtest/gtest.h>

#include "tests/vm/uvc/vhci_port.h"

namespace waymark::testing {
namespace {

constexpr std::chrono::milliseconds kPatience(30'000);
constexpr int kFewRows = 60;  // from one to the next; they tell the pictures apart

int distance(const ImageView& image, const Bytes& picture, int row_step) {
  int worst = 0;
  for (int y = 0; y < image.height; y += row_step) {
    const std::uint8_t* expected = picture.data() + static_cast<std::ptrdiff_t>(y) * image.width;
    const std::uint8_t* row = image.row(y);
    for (int x = 0; x < image.width; ++x) worst = std::max(worst, std::abs(row[x] - expected[x]));
  }
  return worst;
}

}  // namespace

capture::SourceOptions filmOptions(const std::string& format) {
  capture::SourceOptions options;
  options.fps = kFilmRate_hz;
  options.camera.format = format;
  options.camera.width = film().calibration().width;
  options.camera.height = film().calibration().height;
  return options;
}

std::string plugInAt(UvcCamera* camera, int port) {
  const Status plugged = plugIn(camera, port);
  EXPECT_TRUE(plugged) << plugged.error().message;
  const auto node = videoNode(port, kPatience);
  if (node) return node->string();
  ADD_FAILURE() << node.error().message;
  return {};
}

std::unique_ptr<capture::FrameSource> openForTest(const std::string& spec,
                                                  const capture::SourceOptions& options) {
  auto source = capture::openSource(spec, options);
  if (source) return std::move(*source);
  ADD_FAILURE() << source.error().message;
  return nullptr;
}

capture::FramePtr readFrame(capture::FrameSource* source) {
  capture::ReadResult read = source->read(kPatience);
  if (auto* frame = std::get_if<capture::FramePtr>(&read)) return std::move(*frame);
  const auto* error = std::get_if<Error>(&read);
  ADD_FAILURE() << (error != nullptr ? error->message : "no frame in time");
  return nullptr;
}

FilmPictures::FilmPictures(const StreamMode& mode) {
  for (int i = 0; i < film().pictures(); ++i) pictures_.push_back(film().grey(mode, i));
}

FilmPictures::Match FilmPictures::find(const ImageView& image) const {
  const auto nearest = std::ranges::min_element(
      pictures_, {}, [&image](const Bytes& picture) { return distance(image, picture, kFewRows); });
  return {static_cast<int>(nearest - pictures_.begin()), distance(image, *nearest, 1)};
}

}  // namespace waymark::testing
