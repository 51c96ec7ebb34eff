// What the service may not do.
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/syscall.h>

#include "tests/vm/inside_call.h"
#include "tests/vm/service_fixture.h"

namespace waymark::testing {
namespace {

namespace fs = std::filesystem;

class Inside {
 public:
  explicit Inside(pid_t process) : call_(process) {}
  [[nodiscard]] InsideCall& operator*() { return call_; }
  [[nodiscard]] bool held() const { return call_.held(); }

  // 0 when it works, errno when it is rejected.
  int opening(const std::string& path, int flags) { return errorOf(call_.open(path, flags)); }
  int socket(int family, int type) { return errorOf(call_.socket(family, type)); }
  int calling(long number, std::array<std::uint64_t, 6> arguments = {}) {
    return errorOf(call_.call(number, arguments), false);
  }
  // Sends a datagram to the address, discard's port.
  int sendingTo(const char* address) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(9);
    inet_pton(AF_INET, address, &to.sin_addr);
    const std::optional<long> fd = call_.socket(AF_INET, SOCK_DGRAM);
    if (!fd || *fd < 0) return -1;
    const std::uint64_t there =
        call_.place(std::string(reinterpret_cast<const char*>(&to), sizeof to));
    const int error = errorOf(
        call_.call(SYS_sendto, {static_cast<std::uint64_t>(*fd), there, 4, 0, there, sizeof to}),
        false);
    call_.close(*fd);
    return error;
  }

 private:
  int errorOf(std::optional<long> answer, bool close = true) {
    if (!answer) return -1;
    if (*answer < 0) return static_cast<int>(-*answer);
    if (close) call_.close(*answer);
    return 0;
  }

  InsideCall call_;
};

TEST_F(ServiceTest, FromInsideNothingOpensThatIsNotItsOwn) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  write("/home/somebody/letter", "private\n");
  fs::permissions("/home/somebody/letter", fs::perms::all);
  fs::permissions("/dev/ttyS0", fs::perms::all);
  {
    Inside inside(mainProcess());
    ASSERT_TRUE(inside.held());
    // That this is a way to look at all:
    EXPECT_EQ(inside.opening(kConfiguration, O_RDONLY), 0);
    EXPECT_EQ(inside.opening("/var/lib/waymark/probe", O_WRONLY | O_CREAT), 0);
    EXPECT_EQ(inside.opening("/run/waymark/probe", O_WRONLY | O_CREAT), 0);
    EXPECT_EQ(inside.opening("/tmp/probe", O_WRONLY | O_CREAT), 0) << "its own /tmp";

    EXPECT_EQ(inside.opening("/etc/shadow", O_RDONLY), EACCES);
    EXPECT_EQ(inside.opening("/home/somebody/letter", O_RDONLY), EACCES);
    EXPECT_EQ(inside.opening("/etc/waymark/probe", O_WRONLY | O_CREAT), EACCES);
    EXPECT_EQ(inside.opening("/usr/bin/probe", O_WRONLY | O_CREAT), EROFS);
    EXPECT_EQ(inside.opening("/var/lib/probe", O_WRONLY | O_CREAT), EROFS);
    EXPECT_EQ(inside.opening("/dev/kmsg", O_RDONLY), EACCES);
    EXPECT_EQ(inside.opening("/dev/ttyS0", O_RDWR | O_NOCTTY), EPERM) << "not its kind of device";
    EXPECT_EQ(inside.opening("/proc/1/status", O_RDONLY), ENOENT) << "no other processes";
    EXPECT_EQ(inside.opening("/proc/sys/kernel/hostname", O_RDONLY), ENOENT);
  }
  EXPECT_FALSE(fs::exists("/tmp/probe"));
  EXPECT_TRUE(posesCome(3, *subscriber_)) << "it goes on as if nothing had been";
}

TEST_F(ServiceTest, FromInsideThereIsNoTcpAndNobodyToTalkTo) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  {
    Inside inside(mainProcess());
    ASSERT_TRUE(inside.held());
    EXPECT_EQ(inside.socket(AF_INET, SOCK_DGRAM), 0);
    EXPECT_EQ(inside.socket(AF_UNIX, SOCK_STREAM), 0);
    EXPECT_EQ(inside.socket(AF_NETLINK, SOCK_RAW), 0);
    EXPECT_EQ(inside.sendingTo("239.255.76.67"), 0);

    EXPECT_EQ(inside.socket(AF_INET, SOCK_STREAM), EACCES);
    EXPECT_EQ(inside.socket(AF_INET6, SOCK_STREAM), EACCES);
    EXPECT_EQ(inside.socket(AF_INET6, SOCK_DGRAM), EAFNOSUPPORT);
    EXPECT_EQ(inside.socket(AF_PACKET, SOCK_RAW), EAFNOSUPPORT);
    EXPECT_EQ(inside.sendingTo("127.0.0.1"), EPERM);
  }
  EXPECT_TRUE(posesCome(3, *subscriber_));
}

TEST_F(ServiceTest, FromInsideCallsOfTheMightyAreRejected) {
  ASSERT_NO_FATAL_FAILURE(ensureRunning());
  {
    Inside inside(mainProcess());
    ASSERT_TRUE(inside.held());
    EXPECT_EQ(inside.calling(SYS_getpid), 0);
    EXPECT_EQ(inside.calling(SYS_setuid, {0}), EPERM);
    EXPECT_EQ(inside.calling(SYS_unshare, {CLONE_NEWUSER}), EPERM);
    EXPECT_EQ(inside.calling(SYS_mount), EPERM);
    EXPECT_EQ(inside.calling(SYS_init_module), EPERM);
    EXPECT_EQ(inside.calling(SYS_ptrace), EPERM);
    EXPECT_EQ(inside.calling(SYS_bpf), EPERM);
    EXPECT_EQ(inside.calling(SYS_io_uring_setup, {1}), EACCES) << "by the daemon itself";
    EXPECT_EQ(inside.calling(SYS_kill, {1, SIGTERM}), EPERM);
    constexpr std::uint64_t kWritableCode = PROT_READ | PROT_WRITE | PROT_EXEC;
    constexpr std::uint64_t kOwnMemory = MAP_PRIVATE | MAP_ANONYMOUS;
    EXPECT_EQ(inside.calling(SYS_mmap, {0, 4096, kWritableCode, kOwnMemory, ~0ULL, 0}), EPERM);
  }
  EXPECT_TRUE(posesCome(3, *subscriber_));
}

}  // namespace
}  // namespace waymark::testing
