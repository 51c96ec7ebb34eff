#include "daemon/control/control_request.h"

#include <algorithm>
#include <array>
#include <functional>
#include <optional>
#include <string_view>

#include "io/text/json_node.h"

namespace waymark::daemon {
namespace {

using io::Json;

// A request under reading: the first fault is kept.
class Reader {
 public:
  explicit Reader(const Json& json) : json_(json) {}

  // The text of a key; a fault when it is missing or no text.
  std::string text(const char* key) {
    const std::optional<std::string> value = optionalText(key);
    if (!value) object(std::string(key) + ": is missing");
    return value.value_or("");
  }
  std::optional<std::string> optionalText(const char* key) {
    const auto found = json_.find(key);
    if (found == json_.end()) return std::nullopt;
    if (!found->is_string()) object(std::string(key) + ": must be text");
    return found->is_string() ? found->get<std::string>() : std::string();
  }

  // Keys beside "command" that nobody asked for.
  void expectOnly(std::string_view allowed) {
    for (const auto& item : json_.items()) {
      if (item.key() != "command" && item.key() != allowed) object(item.key() + ": unknown key");
    }
  }

  void object(const std::string& fault) {
    if (fault_.empty()) fault_ = fault;
  }
  [[nodiscard]] const std::string& fault() const { return fault_; }

 private:
  const Json& json_;
  std::string fault_;
};

ControlRequest readLoadMap(Reader* reader) {
  const std::filesystem::path file = reader->optionalText("file").value_or("");
  // The daemon's working directory means nothing to its clients.
  if (!file.empty() && file.is_relative()) reader->object("file: must be an absolute path");
  return LoadMapRequest{file};
}

ControlRequest readRecord(Reader* reader) {
  const std::string action = reader->text("action");
  if (action != "start" && action != "stop") {
    reader->object(R"(action: must be "start" or "stop")");
  }
  return RecordRequest{action == "start"};
}

ControlRequest readLogLevel(Reader* reader) {
  const std::string name = reader->text("level");
  const std::optional<LogLevel> level = logLevelByName(name);
  if (!level) reader->object(R"(level: must be "error", "warning", "info" or "debug")");
  return SetLogLevelRequest{level.value_or(LogLevel::kInfo)};
}

struct Command {
  std::string_view name;
  std::string_view argument;  // the key that goes with it, if any
  std::function<ControlRequest(Reader*)> read;
};

template <typename Request>
ControlRequest plain(Reader* /*reader*/) {
  return Request{};
}

const std::array<Command, 9>& commands() {
  static const std::array<Command, 9> kCommands = {{
      {"status", "", plain<StatusRequest>},
      {"save-map", "", plain<SaveMapRequest>},
      {"load-map", "file", readLoadMap},
      {"reset", "", plain<ResetRequest>},
      {"calibration", "", plain<CalibrationRequest>},
      {"record", "action", readRecord},
      {"preview", "", plain<PreviewRequest>},
      {"reload", "", plain<ReloadRequest>},
      {"set-log-level", "level", readLogLevel},
  }};
  return kCommands;
}

std::string known() {
  std::string names;
  for (const Command& command : commands()) {
    names += (names.empty() ? "" : ", ") + std::string(command.name);
  }
  return names;
}

}  // namespace

Result<ControlRequest> parseControlRequest(const std::string& line) {
  const Result<Json> json = io::parseJson(line, "request");
  if (!json) return json.error();
  if (!json->is_object()) return Error{"request: must be an object {...}"};
  Reader reader(*json);
  const std::string name = reader.text("command");
  if (!reader.fault().empty()) return Error{reader.fault()};
  const auto command = std::ranges::find(commands(), name, &Command::name);
  if (command == commands().end()) {
    return Error{"command: \"" + name + "\" is not known; known are " + known()};
  }
  reader.expectOnly(command->argument);
  const ControlRequest request = command->read(&reader);
  if (!reader.fault().empty()) return Error{name + ": " + reader.fault()};
  return request;
}

}  // namespace waymark::daemon
