#include <algorithm>
#include <cstdlib>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include <gtest/gtest.h>

#include "capture/libcamera/libcamera_source.h"
#include "capture/libcamera/manager.h"

namespace waymark::capture {
namespace {

TEST(LibcameraMessages, GoToTheSinkAndNotToStderr) {
  // Read when libcamera's log begins. It tells its version when it starts.
  ASSERT_EQ(setenv("LIBCAMERA_LOG_LEVELS", "Camera:INFO", 1), 0);
  std::mutex mutex;
  std::vector<std::string> lines;
  ::testing::internal::CaptureStderr();
  {
    const LibcameraMessages messages([&](std::string_view line) {
      const std::lock_guard lock(mutex);
      lines.emplace_back(line);
    });
    const auto manager = libcam::sharedManager();
    EXPECT_TRUE(manager) << manager.error().message;
  }
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  EXPECT_TRUE(std::ranges::any_of(
      lines, [](const std::string& line) { return line.find("libcamera v") != std::string::npos; }))
      << "of " << lines.size() << " lines";
  for (const std::string& line : lines) EXPECT_EQ(line.find('\n'), std::string::npos) << line;
}

}  // namespace
}  // namespace waymark::capture
