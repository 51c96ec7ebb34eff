#include "daemon/health/temperatures.h"

#include <fstream>

#include <gtest/gtest.h>

#include "tests/temporary_directory.h"

namespace waymark::daemon {
namespace {

namespace fs = std::filesystem;

TEST(Temperatures, ReadsTheZonesThatCanBeRead) {
  const waymark::testing::TemporaryDirectory temporary;
  const fs::path root = temporary / "thermal";
  const auto zone = [&](const char* name, const char* type, const char* millidegrees) {
    fs::create_directories(root / name);
    std::ofstream(root / name / "type") << type << '\n';
    std::ofstream(root / name / "temp") << millidegrees << '\n';
  };
  zone("thermal_zone0", "x86_pkg_temp", "41500");
  zone("thermal_zone1", "broken", "");
  zone("cooling_device0", "fan", "1");
  zone("thermal_zone2", "acpitz", "-2000");

  const std::vector<temperature_t> read = readTemperatures(root);
  ASSERT_EQ(read.size(), 2u);
  EXPECT_EQ(read[0].name, "acpitz");
  EXPECT_DOUBLE_EQ(read[0].celsius, -2.0);
  EXPECT_EQ(read[1].name, "x86_pkg_temp");
  EXPECT_DOUBLE_EQ(read[1].celsius, 41.5);
  fs::remove_all(root);
  EXPECT_TRUE(readTemperatures(root).empty());
}

}  // namespace
}  // namespace waymark::daemon
