#include "tests/vm/uvc/scene_film.h"

#include <stdexcept>
#include <thread>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "simulator/simulation.h"

namespace waymark::testing {
namespace {

// Of the simulated time: the test camera sends at the pace that its host asks for.
constexpr double kRate_hz = 7.5;
constexpr double kDuration_s = 20.0;  // once round the room
constexpr std::size_t kPictures = 16;
constexpr int kWidth = 640;
constexpr int kHeight = 480;
constexpr std::size_t kThreads = 2;  // the guest has two processors

Bytes encodeJpeg(Bytes& grey) {
  cv::Mat colour;
  cv::cvtColor(cv::Mat(kHeight, kWidth, CV_8UC1, grey.data()), colour, cv::COLOR_GRAY2BGR);
  Bytes jpeg;
  cv::imencode(".jpg", colour, jpeg, {cv::IMWRITE_JPEG_QUALITY, 90});
  return jpeg;
}

// Grey pixels between neutral colours.
Bytes encodeYuyv(const Bytes& grey) {
  constexpr std::uint8_t kNeutral = 128;
  Bytes yuyv(2 * grey.size(), kNeutral);
  for (std::size_t i = 0; i < grey.size(); ++i) yuyv[2 * i] = grey[i];
  return yuyv;
}

}  // namespace

SceneFilm::SceneFilm() : grey_(kPictures, Bytes(kWidth * kHeight)), jpeg_(kPictures) {
  simulator::Options options;
  options.size = simulator::ImageSize{kWidth, kHeight};
  options.rate_hz = kRate_hz;
  options.duration_s = kDuration_s;
  const auto simulation = simulator::Simulation::create(options, simulator::Ending::kOfTheScene);
  if (!simulation) throw std::runtime_error(simulation.error().message);
  calibration_ = (*simulation)->camera();
  std::vector<std::jthread> threads;
  for (std::size_t first = 0; first < kThreads; ++first) {
    threads.emplace_back([this, first, &simulation] {
      simulator::Simulation::Workspace workspace;
      for (std::size_t i = first; i < kPictures; i += kThreads) {
        (*simulation)->render(static_cast<std::int64_t>(i), &workspace, grey_[i].data());
        jpeg_[i] = encodeJpeg(grey_[i]);
      }
    });
  }
}

const SceneFilm& SceneFilm::shared() {
  static const SceneFilm film;
  return film;
}

int SceneFilm::pictureOf(std::uint64_t index) const {
  const int at = static_cast<int>(index % static_cast<std::uint64_t>(period()));
  return at < pictures() ? at : period() - at;
}

Bytes SceneFilm::encoded(const StreamMode& mode, int picture) const {
  const auto at = static_cast<std::size_t>(picture);
  switch (mode.format) {
    case PixelFormat::kMjpeg:
      return jpeg_[at];
    case PixelFormat::kYuyv:
      return encodeYuyv(grey_[at]);
    case PixelFormat::kGrey:
      return grey_[at];
  }
  return {};
}

Bytes SceneFilm::grey(const StreamMode& mode, int picture) const {
  const auto at = static_cast<std::size_t>(picture);
  if (mode.format != PixelFormat::kMjpeg) return grey_[at];
  const cv::Mat decoded = cv::imdecode(jpeg_[at], cv::IMREAD_GRAYSCALE);
  return {decoded.datastart, decoded.dataend};
}

CameraOptions SceneFilm::camera() const {
  CameraOptions options;
  options.frames = [this](const StreamMode& mode, std::uint64_t index) {
    return encoded(mode, pictureOf(index));
  };
  return options;
}

}  // namespace waymark::testing
