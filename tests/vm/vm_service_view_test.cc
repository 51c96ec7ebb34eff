// waymark-view as a service: from its package, confined, beside the daemon's.
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <gtest/gtest.h>

#include "base/clock.h"
#include "tests/process.h"
#include "tests/vm/service_fixture.h"

namespace waymark::testing {
namespace {

namespace beast = boost::beast;
using boost::asio::ip::tcp;

constexpr const char* kViewUnit = "waymark-view.service";
constexpr unsigned short kPort = 8787;

// What a page is sent.
class Page {
 public:
  // False where nobody serves it.
  [[nodiscard]] bool open() {
    boost::system::error_code failed;
    socket_.next_layer().connect({boost::asio::ip::address_v4::loopback(), kPort}, failed);
    if (!failed) socket_.handshake("127.0.0.1:" + std::to_string(kPort), "/ws", failed);
    socket_.read_message_max(std::size_t{16} << 20U);
    return !failed;
  }
  // Reads until a message has that in it. (Something is sent always.)
  [[nodiscard]] bool hears(const std::string& what) {
    const std::int64_t begin_ns = monotonicNs();
    while (monotonicNs() - begin_ns < 1'000'000LL * kPatience.count()) {
      beast::flat_buffer buffer;
      boost::system::error_code failed;
      socket_.read(buffer, failed);
      if (failed) return false;
      const std::string text = beast::buffers_to_string(buffer.data());
      if (text.find(what) != text.npos) return true;
    }
    return false;
  }

 private:
  boost::asio::io_context io_;
  beast::websocket::stream<tcp::socket> socket_{io_};
};

TEST_F(ServiceTest, ThePageIsAServiceOfItsOwn) {
  // Images are only made while no frame waits.
  constexpr double kUnhurried_hz = 1.0;
  write(kConfiguration, simulated(kUnhurried_hz, "", "TEST"));
  ASSERT_EQ(runProgram({"systemctl", "restart", kUnit}).exit_code, 0) << journal();
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  const ProgramResult installed = dpkg("-i " WAYMARK_PACKAGES "/waymark-view_*.deb");
  ASSERT_EQ(installed.exit_code, 0) << installed.out << installed.err;
  write("/etc/systemd/system/waymark-view.service.d/channels.conf",
        "[Service]\nExecStart=\nExecStart=/usr/bin/waymark-view --channel-prefix TEST_\n");
  ASSERT_EQ(runProgram({"systemctl", "daemon-reload"}).exit_code, 0);
  EXPECT_EQ(property("ActiveState", kViewUnit), "inactive") << "installing starts nothing";
  ASSERT_EQ(runProgram({"systemctl", "start", kViewUnit}).exit_code, 0);
  const std::string begun = property("MainPID", kViewUnit);

  std::optional<Page> page;
  const std::int64_t begin_ns = monotonicNs();
  while (!page && monotonicNs() - begin_ns < 1'000'000LL * kPatience.count()) {
    if (!page.emplace().open()) page.reset();
  }
  ASSERT_TRUE(page);
  EXPECT_TRUE(page->hears("\"tracking\"")) << "poses, over multicast";
  EXPECT_TRUE(page->hears("data:image/jpeg")) << "images, asked for at the control socket; "
                                              << runProgram({"waymark", "ctl", "status"}).out;
  page.reset();
  EXPECT_EQ(property("MainPID", kViewUnit), begun);
  EXPECT_EQ(property("NRestarts", kViewUnit), "0");

  ASSERT_EQ(dpkg("--purge waymark-view").exit_code, 0);
  EXPECT_NE(property("ActiveState", kViewUnit), "active") << "removing ends it";
  EXPECT_EQ(shell("rm -r /etc/systemd/system/waymark-view.service.d && systemctl daemon-reload")
                .exit_code,
            0);
  EXPECT_EQ(property("LoadState", kViewUnit), "not-found");
  EXPECT_TRUE(posesCome(3, *subscriber_)) << "the daemon goes on";
}

}  // namespace
}  // namespace waymark::testing
