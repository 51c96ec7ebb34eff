#include "daemon/system/datagrams_only.h"

#include <cerrno>
#include <thread>

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

namespace waymark::daemon {
namespace {

// errno of opening such a socket, 0 when it opens.
int opening(int family, int type, int protocol = 0) {
  const int fd = socket(family, type, protocol);
  if (fd < 0) return errno;
  close(fd);
  return 0;
}

// In a process of its own, as there is no way back.
template <typename Check>
int exitCodeOf(const Check& check) {
  const pid_t child = fork();
  if (child == 0) _exit(allowDatagramsOnly() ? check() : 100);
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

TEST(DatagramsOnly, TcpSocketsCannotBeOpened) {
  ASSERT_EQ(opening(AF_INET, SOCK_STREAM), 0) << "as long as nobody forbids it";
  EXPECT_EQ(exitCodeOf([] { return opening(AF_INET, SOCK_STREAM); }), EACCES);
  EXPECT_EQ(exitCodeOf([] { return opening(AF_INET, SOCK_STREAM | SOCK_CLOEXEC); }), EACCES);
  EXPECT_EQ(exitCodeOf([] { return opening(AF_INET, SOCK_STREAM, IPPROTO_TCP); }), EACCES);
  EXPECT_EQ(exitCodeOf([] { return opening(AF_INET6, SOCK_STREAM); }), EACCES);
  EXPECT_EQ(exitCodeOf([] {
              const long fd = syscall(SYS_io_uring_setup, 1, nullptr);
              return fd < 0 ? errno : 0;
            }),
            EACCES);
}

TEST(DatagramsOnly, ThreadsStartedLaterCannotEither) {
  EXPECT_EQ(exitCodeOf([] {
              int error = 0;
              std::thread([&] { error = opening(AF_INET, SOCK_STREAM); }).join();
              return error;
            }),
            EACCES);
}

TEST(DatagramsOnly, WhatTheDaemonNeedsStays) {
  EXPECT_EQ(exitCodeOf([] { return opening(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC); }), 0);
  EXPECT_EQ(exitCodeOf([] { return opening(AF_UNIX, SOCK_STREAM); }), 0);
  EXPECT_EQ(exitCodeOf([] { return opening(AF_NETLINK, SOCK_RAW); }), 0);
}

}  // namespace
}  // namespace waymark::daemon
