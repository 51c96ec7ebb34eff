// waymarkd as a service: installed from its package, started and watched by a real systemd,
// confined. What scripts/package has built must be there. Guest machine only.
#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>

#include <gtest/gtest.h>
#include <sys/types.h>

#include "tests/process.h"
#include "tests/subscriber.h"

namespace waymark::testing {

// The guest's processors are emulated, perhaps on a busy computer: all takes its time.
inline constexpr std::chrono::milliseconds kPatience(120'000);
inline constexpr const char* kUnit = "waymarkd.service";
inline constexpr const char* kConfiguration = "/etc/waymark/waymarkd.toml";
inline constexpr const char* kMap = "/var/lib/waymark/map.json";

// --- Programs ------------------------------------------------------------------------------------

[[nodiscard]] ProgramResult shell(const std::string& command);
[[nodiscard]] std::string trimmed(std::string text);
// Of a unit, as systemd tells it.
[[nodiscard]] std::string property(const std::string& name, const std::string& unit = kUnit);
[[nodiscard]] pid_t mainProcess(const std::string& unit = kUnit);
// What the programs of the unit have written since it was first started.
[[nodiscard]] std::string journal(const std::string& unit = kUnit);
[[nodiscard]] std::size_t countOf(const std::string& what, const std::string& text);

// --- Configurations ------------------------------------------------------------------------------

void write(const std::filesystem::path& file, const std::string& text);

// A small simulated camera that always sees markers. What is tested is the service, not what it
// computes.
[[nodiscard]] std::string simulated(double rate_hz, const std::string& slam,
                                    const std::string& channels);
// An emulated processor has no time for more: of its floating point, a frame's markers take 0.2 s.
inline constexpr double kRate_hz = 3.0;
[[nodiscard]] std::string keepingItsMap();

// The tests of this suite are in several files. They run in the order in which those are linked:
// the first ones find the service freshly installed, the last one purges it.
class ServiceTest : public ::testing::Test {
 protected:
  static constexpr const char* kUrl = "udpm://239.255.76.67:7667?ttl=0";

  static void SetUpTestSuite();
  void SetUp() override;

  // dpkg with what it knows of the installed packages, but not of their files: reading that takes
  // minutes in here, and tests/package/clean_root does it all. Other packages' triggers have
  // nothing to do.
  [[nodiscard]] static ProgramResult dpkg(const std::string& arguments);

  // Starts the service where it does not run, and waits for poses.
  void ensureRunning();
  // Poses of frames from now on.
  [[nodiscard]] static bool posesCome(std::size_t count, const Subscriber& subscriber);

  std::optional<Subscriber> subscriber_;

 private:
  static void install();

  static std::optional<ProgramResult> installed_;
  static bool of_this_build_;
};

}  // namespace waymark::testing
