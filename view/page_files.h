// The files of the page, read once: nothing is looked up on a disk for who asks.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "base/result.h"
#include "view/web_server.h"

namespace waymark::view {

// page: the directory of our own files; three: of three.js (build/ and examples/ in it); health:
// docs/health.md, whose tables say what helps when a counter grows. What is missing is an error
// that names it.
[[nodiscard]] Result<std::map<std::string, PageFile>> readPageFiles(
    const std::filesystem::path& page, const std::filesystem::path& three,
    const std::filesystem::path& health);

// {"dropped.queue": "the SLAM loop is late: ...", ...} of the tables "| counter | ... | what to do
// |".
[[nodiscard]] std::string adviceJson(const std::string& health_md);

}  // namespace waymark::view
