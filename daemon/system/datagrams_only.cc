#include "daemon/system/datagrams_only.h"

#include <array>
#include <bit>
#include <cerrno>
#include <cstddef>
#include <cstdint>

#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>

#include "base/system_reason.h"

namespace waymark::daemon {
namespace {

#if defined(__x86_64__)
constexpr std::uint32_t kProcessor = AUDIT_ARCH_X86_64;
#elif defined(__aarch64__)
constexpr std::uint32_t kProcessor = AUDIT_ARCH_AARCH64;
#else
#error "which AUDIT_ARCH is this?"
#endif

constexpr std::uint32_t kSocketType = 0xf;  // the rest are flags: linux/net.h

// The lower half of an argument, which is where an int is.
static_assert(std::endian::native == std::endian::little);
constexpr std::uint32_t argument(std::size_t index) {
  return static_cast<std::uint32_t>(offsetof(seccomp_data, args) + 8 * index);
}

constexpr sock_filter load(std::uint32_t offset) {
  return BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offset);
}
// How many steps to jump over, when equal and when not.
constexpr sock_filter compare(std::uint32_t value, std::uint8_t equal, std::uint8_t other) {
  return BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, equal, other);
}
constexpr sock_filter answer(std::uint32_t action) { return BPF_STMT(BPF_RET | BPF_K, action); }

}  // namespace

Status allowDatagramsOnly() {
  std::array filter{
      load(offsetof(seccomp_data, arch)),
      compare(kProcessor, 0, 9),  // programs for another processor are the service unit's to forbid
      load(offsetof(seccomp_data, nr)),
      compare(SYS_io_uring_setup, 8, 0),  // it makes sockets, too
      compare(SYS_socket, 0, 6),
      load(argument(0)),
      compare(AF_INET, 1, 0),
      compare(AF_INET6, 0, 3),
      load(argument(1)),
      sock_filter BPF_STMT(BPF_ALU | BPF_AND | BPF_K, kSocketType),
      compare(SOCK_DGRAM, 0, 1),
      answer(SECCOMP_RET_ALLOW),
      answer(SECCOMP_RET_ERRNO | EACCES),
  };
  const sock_fprog program{static_cast<unsigned short>(filter.size()), filter.data()};
  // Without it only root may filter its own calls.
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 ||
      prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program, 0, 0) != 0) {
    return Error{"TCP sockets are not given up: " + systemReason()};
  }
  return success();
}

}  // namespace waymark::daemon
