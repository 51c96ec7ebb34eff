// The daemon's configuration, and the settings of waymark run, which are a part of it.
#include "daemon/configuration.h"
#include "io/settings/settings_file.h"
#include "io/settings/slam_settings.h"
#include "tests/fuzz/fuzz_target.h"

using namespace waymark;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text = fuzz::textOf(data, size);
  const auto configuration = daemon::parseConfiguration(text, "/etc/waymark/waymarkd.toml");
  if (!configuration) fuzz::requireOneLine(configuration.error());
  const auto settings = io::parseSlamSettings(text, "slam.toml");
  if (!settings) fuzz::requireOneLine(settings.error());
  // Both read the same keys; only the daemon requires some, and some together.
  fuzz::require(settings.ok() || !configuration.ok(), "what the daemon takes, waymark run takes");
  if (configuration) {
    fuzz::require(configuration->slam.options.invalidReason().empty(), "the options are valid");
    const io::SettingTexts texts = io::settingTexts(configuration->text);
    fuzz::require(!texts.empty(), "a configuration has keys");
    fuzz::require(io::changedSettings(texts, io::settingTexts(text)).empty(), "nothing changed");
  }
  return 0;
}
