// Chromium without a screen, driven over its DevTools protocol. Tests only.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace waymark::testing {

class Browser {
 public:
  using Json = nlohmann::json;

  // Empty where there is no chromium, or it does not start. `directory`: for what it keeps.
  [[nodiscard]] static std::unique_ptr<Browser> start(const std::filesystem::path& directory);
  ~Browser();
  Browser(const Browser&) = delete;
  Browser& operator=(const Browser&) = delete;

  void resize(int width, int height, bool phone);
  void dark(bool wanted);
  void open(const std::string& url);
  // The value of a JavaScript expression in the page; null where it throws.
  Json evaluate(const std::string& expression);
  // Whether it becomes true in time.
  [[nodiscard]] bool becomes(const std::string& expression, int seconds = 30);
  void press(const std::string& key);
  // A PNG.
  void screenshot(const std::filesystem::path& file);
  // What has gone wrong in the page: exceptions, errors on its console, files that did not load.
  [[nodiscard]] const std::vector<std::string>& errors() const { return errors_; }

 private:
  struct Connection;
  Browser();
  Json call(const std::string& method, const Json& parameters = Json::object());
  void note(const Json& event);

  std::unique_ptr<Connection> connection_;
  std::vector<std::string> errors_;
};

}  // namespace waymark::testing
