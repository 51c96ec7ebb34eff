// A picture of the live view, once the map and the camera's image are on it. For
// scripts/view-picture.
//
//   page_picture ADDRESS OUT.png
#include <chrono>
#include <cstdio>
#include <string>
#include <thread>

#include "tests/browser.h"
#include "tests/temporary_directory.h"

namespace waymark::testing {
namespace {

int take(const std::string& address, const std::string& file) {
  const TemporaryDirectory directory;
  const auto browser = Browser::start(directory.path());
  if (!browser) {
    std::fprintf(stderr, "page_picture: needs chromium\n");
    return 2;
  }
  constexpr int kWidth = 1280;
  constexpr int kHeight = 1040;
  constexpr int kPatience_s = 120;
  browser->resize(kWidth, kHeight, /*phone=*/false);
  browser->dark(false);
  browser->open(address);
  for (const char* there :
       {"WaymarkScene.counts().markers > 40", "WaymarkScene.counts().segments > 100",
        "Number(document.getElementById('image').dataset.image) > 0",
        "document.getElementById('image-text').textContent.includes('residual')"}) {
    if (browser->becomes(there, kPatience_s)) continue;
    std::fprintf(stderr, "page_picture: never became true: %s\n", there);
    return 1;
  }
  std::this_thread::sleep_for(std::chrono::seconds(3));  // the plots get something to show
  // Images come and go: one is there as the picture is taken.
  if (!browser->becomes("Number(document.getElementById('image').dataset.image) > 0",
                        kPatience_s)) {
    return 1;
  }
  browser->screenshot(file);
  for (const std::string& error : browser->errors()) {
    std::fprintf(stderr, "page_picture: %s\n", error.c_str());
  }
  return browser->errors().empty() ? 0 : 1;
}

}  // namespace
}  // namespace waymark::testing

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: page_picture ADDRESS OUT.png\n");
    return 2;
  }
  return waymark::testing::take(argv[1], argv[2]);
}
