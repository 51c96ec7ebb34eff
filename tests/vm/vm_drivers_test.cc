// What drivers deliver in many forms: every pixel format of vivid that we can read, with one and
// with several planes, and vimc's camera through libcamera.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include <gtest/gtest.h>
#include <sys/mman.h>

#include "base/clock.h"
#include "capture/libcamera/libcamera_source.h"
#include "capture/open_source.h"
#include "capture/pixel_format.h"
#include "capture/v4l2/camera_list.h"
#include "capture/v4l2/device.h"
#include "tests/process.h"

namespace waymark::testing {
namespace {

using capture::FramePtr;
using capture::FrameSource;
using std::chrono::milliseconds;

constexpr int kWidth = 640;
constexpr int kHeight = 480;

FramePtr readFrame(FrameSource& source) {
  for (int i = 0; i < 100; ++i) {
    capture::ReadResult result = source.read(milliseconds(100));
    if (auto* frame = std::get_if<FramePtr>(&result)) return std::move(*frame);
    if (const auto* error = std::get_if<Error>(&result)) {
      ADD_FAILURE() << error->message;
      return nullptr;
    }
  }
  ADD_FAILURE() << "no frame in 10 s";
  return nullptr;
}

std::unique_ptr<FrameSource> open(const std::string& spec, const capture::SourceOptions& options) {
  Result<std::unique_ptr<FrameSource>> source = capture::openSource(spec, options);
  EXPECT_TRUE(source.ok()) << source.error().message;
  return source.ok() ? std::move(source).value() : nullptr;
}

std::vector<double> pixelsOf(const ImageView& image) {
  std::vector<double> all;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) all.push_back(image.at(x, y));
  }
  return all;
}

// 1 for the same picture at any brightness and contrast.
double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  const auto n = static_cast<double>(a.size());
  double sum_a = 0, sum_b = 0, sum_aa = 0, sum_bb = 0, sum_ab = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    sum_a += a[i];
    sum_b += b[i];
    sum_aa += a[i] * a[i];
    sum_bb += b[i] * b[i];
    sum_ab += a[i] * b[i];
  }
  const double of_a = sum_aa - sum_a * sum_a / n;
  const double of_b = sum_bb - sum_b * sum_b / n;
  return (sum_ab - sum_a * sum_b / n) / std::sqrt(of_a * of_b);
}

// The parameter: vivid's "multiplanar", 1 for formats in one piece of memory, 2 for several.
class VividFormatsTest : public ::testing::TestWithParam<int> {
 protected:
  void SetUp() override {
    (void)runProgram({"modprobe", "-r", "vivid"});
    const ProgramResult loaded =
        runProgram({"modprobe", "vivid", "n_devs=1", "node_types=0x1", "num_inputs=1",
                    "input_types=0", "multiplanar=" + std::to_string(GetParam())});
    ASSERT_EQ(loaded.exit_code, 0) << loaded.err;
    (void)runProgram({"udevadm", "settle"});
    for (const capture::v4l2::Camera& camera : capture::v4l2::listCameras().cameras) {
      if (camera.card.driver == "vivid") path_ = camera.path;
    }
    ASSERT_NE(path_, "");
  }
  void TearDown() override { (void)runProgram({"modprobe", "-r", "vivid"}); }

  // A still picture: colour bars, no text.
  [[nodiscard]] static capture::SourceOptions options(const std::string& format) {
    capture::SourceOptions options;
    options.camera.format = format;
    options.camera.width = kWidth;
    options.camera.height = kHeight;
    options.camera.controls["osd_text_mode"] = std::int64_t{2};
    return options;
  }
  [[nodiscard]] std::vector<std::string> offeredFormats() const {
    const Result<capture::v4l2::Device> device = capture::v4l2::Device::open(path_);
    EXPECT_TRUE(device.ok());
    std::vector<std::string> all;
    for (const capture::OfferedMode& mode : device->modes()) {
      const bool wanted = mode.max_width == kWidth && mode.max_height == kHeight &&
                          capture::findPixelFormat(mode.fourcc) != nullptr;
      if (wanted) all.push_back(capture::fourccText(mode.fourcc));
    }
    return all;
  }

  std::string path_;
};

TEST_P(VividFormatsTest, EveryFormatShowsTheSamePicture) {
  std::vector<double> expected;
  {  // The device streams to one at a time.
    const auto reference = open("v4l2:" + path_, options("GREY"));
    ASSERT_TRUE(reference);
    const FramePtr grey = readFrame(*reference);
    ASSERT_TRUE(grey);
    expected = pixelsOf(grey->image());
  }
  const std::vector<std::string> formats = offeredFormats();
  EXPECT_GE(formats.size(), 12U);
  for (const std::string& format : formats) {
    SCOPED_TRACE(format);
    const auto source = open("v4l2:" + path_, options(format));
    ASSERT_TRUE(source);
    const FramePtr frame = readFrame(*source);
    ASSERT_TRUE(frame);
    ASSERT_EQ(frame->image().width, kWidth);
    ASSERT_EQ(frame->image().height, kHeight);
    // Bayer's edges are interpolated.
    EXPECT_GT(correlation(pixelsOf(frame->image()), expected), 0.98);
    EXPECT_LT(std::abs(monotonicNs() - frame->stamp().monotonic_ns), 2'000'000'000);
  }
}

// The frame's memory as others would get it.
TEST_P(VividFormatsTest, FramesInPlaceAreExportedAsDmaBuf) {
  const auto source = open("v4l2:" + path_, options("GREY"));
  ASSERT_TRUE(source);
  const FramePtr frame = readFrame(*source);
  ASSERT_TRUE(frame);
  ASSERT_GE(frame->dmaBuf(), 0);
  constexpr std::size_t kBytes = std::size_t{kWidth} * kHeight;
  void* const mapped = mmap(nullptr, kBytes, PROT_READ, MAP_SHARED, frame->dmaBuf(), 0);
  ASSERT_NE(mapped, MAP_FAILED);
  EXPECT_TRUE(std::equal(frame->image().data, frame->image().data + kBytes,
                         static_cast<const std::uint8_t*>(mapped)));
  munmap(mapped, kBytes);
}

INSTANTIATE_TEST_SUITE_P(Planes, VividFormatsTest, ::testing::Values(1, 2));

// libcamera passes over devices whose nodes are still being made. Empty when it never finds it.
std::string vimcInTime() {
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (std::chrono::steady_clock::now() < until) {
    for (const capture::LibcameraCamera& camera : capture::listLibcameras()) {
      if (camera.id.find("vimc") != std::string::npos) return camera.id;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  }
  return {};
}

TEST(VimcLibcameraTest, FramesOfItsSensor) {
  const ProgramResult loaded = runProgram({"modprobe", "vimc"});
  ASSERT_EQ(loaded.exit_code, 0) << loaded.err;
  (void)runProgram({"udevadm", "settle"});
  const std::string id = vimcInTime();
  ASSERT_NE(id, "");
  capture::SourceOptions options;
  // The scaler's sizes are multiples of three.
  options.camera.width = 636;
  options.camera.height = kHeight;
  const auto source = open("libcamera:" + id, options);
  ASSERT_TRUE(source);
  std::int64_t before_ns = 0;
  for (int i = 0; i < 3; ++i) {
    const FramePtr frame = readFrame(*source);
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->image().width, 636);
    EXPECT_GT(frame->stamp().monotonic_ns, before_ns);
    before_ns = frame->stamp().monotonic_ns;
    const std::vector<double> pixels = pixelsOf(frame->image());
    EXPECT_GT(*std::ranges::max_element(pixels), *std::ranges::min_element(pixels) + 50.0)
        << "its colour bars";
  }
  // A size that it would adjust is rejected, and the message says what it would give.
  options.camera.width = 640;
  const auto rejected = capture::openSource("libcamera:" + id, options);
  ASSERT_FALSE(rejected.ok());
}

}  // namespace
}  // namespace waymark::testing
