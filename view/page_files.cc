#include "view/page_files.h"

#include <array>
#include <string_view>
#include <utility>
#include <vector>

#include "io/text/json_node.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"

namespace waymark::view {
namespace {

namespace fs = std::filesystem;

constexpr const char* kScript = "text/javascript; charset=utf-8";

// The names in backticks in a cell: "`a.b`, `c`".
std::vector<std::string> namesIn(std::string_view cell) {
  std::vector<std::string> names;
  for (std::size_t from = cell.find('`'); from != cell.npos; from = cell.find('`', from)) {
    const std::size_t to = cell.find('`', from + 1);
    if (to == cell.npos) break;
    names.emplace_back(cell.substr(from + 1, to - from - 1));
    from = to + 1;
  }
  return names;
}

}  // namespace

std::string adviceJson(const std::string& health_md) {
  io::Json advice = io::Json::object();
  for (const std::string_view line : io::split(health_md, '\n')) {
    if (!line.starts_with("| `")) continue;
    const std::vector<std::string_view> cells = io::split(line, '|');
    // Before the first and after the last bar there is nothing.
    if (cells.size() < 5) continue;
    for (const std::string& name : namesIn(cells[1])) {
      advice[name] = {{"counts", cells[2]}, {"help", cells[3]}};
    }
  }
  return advice.dump(-1, ' ', false, io::Json::error_handler_t::replace);
}

Result<std::map<std::string, PageFile>> readPageFiles(const fs::path& page, const fs::path& three,
                                                      const fs::path& health) {
  struct Source {
    const char* name;
    fs::path path;
    const char* type;
  };
  const std::array<Source, 9> sources = {{
      {"index.html", page / "index.html", "text/html; charset=utf-8"},
      {"view.css", page / "view.css", "text/css; charset=utf-8"},
      {"view.js", page / "view.js", kScript},
      {"scene.js", page / "scene.js", kScript},
      {"panels.js", page / "panels.js", kScript},
      {"offline.js", page / "offline.js", kScript},
      {"three.min.js", three / "three.min.js", kScript},
      {"OrbitControls.js", three / "examples/js/controls/OrbitControls.js", kScript},
      {"advice.json", health, "application/json"},
  }};
  std::map<std::string, PageFile> files;
  for (const Source& source : sources) {
    Result<std::string> content = io::readTextFile(source.path);
    if (!content) return content.error();
    files[source.name] = {source.type, std::move(content).value()};
  }
  files["advice.json"].content = adviceJson(files["advice.json"].content);
  return files;
}

}  // namespace waymark::view
