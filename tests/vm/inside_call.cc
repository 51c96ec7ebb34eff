#include "tests/vm/inside_call.h"

#include <filesystem>
#include <fstream>
#include <system_error>

#include <fcntl.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>

namespace waymark::testing {
namespace {

constexpr std::size_t kRoom = 1024;    // bytes for place(), on the stack
constexpr std::size_t kRedZone = 128;  // bytes below the stack pointer that belong to the function
constexpr std::uint64_t kSyscall = 2;  // bytes of the instruction
constexpr long kInstruction = 0x050f;  // it
constexpr long kInstructionMask = 0xffff;

bool waitForStop(pid_t thread) {
  int status = 0;
  return waitpid(thread, &status, __WALL) == thread && WIFSTOPPED(status);
}

bool stop(pid_t thread) {
  return ptrace(PTRACE_SEIZE, thread, 0, 0) == 0 && ptrace(PTRACE_INTERRUPT, thread, 0, 0) == 0 &&
         waitForStop(thread);
}

}  // namespace

InsideCall::InsideCall(pid_t thread) : thread_(thread) {
  if (!stop(thread)) return;
  held_ = ptrace(PTRACE_GETREGS, thread_, 0, &registers_) == 0 &&
          (ptrace(PTRACE_PEEKTEXT, thread_, registers_.rip - kSyscall, 0) & kInstructionMask) ==
              kInstruction;
  if (!held_) ptrace(PTRACE_DETACH, thread_, 0, 0);
}

InsideCall::~InsideCall() {
  if (!held_) return;
  ptrace(PTRACE_SETREGS, thread_, 0, &registers_);
  ptrace(PTRACE_DETACH, thread_, 0, 0);
}

std::optional<long> InsideCall::call(long number, std::array<std::uint64_t, 6> arguments) {
  user_regs_struct registers = registers_;
  registers.rip -= kSyscall;
  // Without it the system would take this for the call that was interrupted.
  registers.orig_rax = ~0ULL;
  registers.rax = static_cast<std::uint64_t>(number);
  registers.rdi = arguments[0];
  registers.rsi = arguments[1];
  registers.rdx = arguments[2];
  registers.r10 = arguments[3];
  registers.r8 = arguments[4];
  registers.r9 = arguments[5];
  if (ptrace(PTRACE_SETREGS, thread_, 0, &registers) != 0 ||
      ptrace(PTRACE_SINGLESTEP, thread_, 0, 0) != 0 || !waitForStop(thread_) ||
      ptrace(PTRACE_GETREGS, thread_, 0, &registers) != 0 || registers.rip != registers_.rip) {
    return std::nullopt;
  }
  return static_cast<long>(registers.rax);
}

std::uint64_t InsideCall::place(const std::string& bytes) {
  const std::uint64_t address = (registers_.rsp - kRedZone - kRoom) & ~std::uint64_t{15};
  iovec here{const_cast<char*>(bytes.c_str()), bytes.size() + 1};
  // NOLINTNEXTLINE(performance-no-int-to-ptr): it points into the other process
  iovec there{reinterpret_cast<void*>(address), bytes.size() + 1};
  const bool written = bytes.size() < kRoom && process_vm_writev(thread_, &here, 1, &there, 1, 0) ==
                                                   static_cast<ssize_t>(here.iov_len);
  return written ? address : 0;
}

std::optional<long> InsideCall::open(const std::string& path, int flags) {
  constexpr std::uint64_t kMode = 0600;
  return call(SYS_openat, {static_cast<std::uint64_t>(AT_FDCWD), place(path),
                           static_cast<std::uint64_t>(flags | O_CLOEXEC), kMode});
}

std::optional<long> InsideCall::socket(int family, int type) {
  return call(SYS_socket,
              {static_cast<std::uint64_t>(family), static_cast<std::uint64_t>(type), 0});
}

void InsideCall::close(long fd) { call(SYS_close, {static_cast<std::uint64_t>(fd)}); }

StoppedThread::StoppedThread(pid_t thread) : thread_(thread), held_(stop(thread)) {}

StoppedThread::~StoppedThread() {
  if (held_) ptrace(PTRACE_DETACH, thread_, 0, 0);
}

void StoppedThread::takeNote() {
  int status = 0;
  if (held_ && waitpid(thread_, &status, __WALL | WNOHANG) == thread_ && !WIFSTOPPED(status)) {
    held_ = false;
  }
}

pid_t threadNamed(pid_t process, const std::string& name) {
  std::error_code error;
  const std::filesystem::path tasks = "/proc/" + std::to_string(process) + "/task";
  for (const auto& entry : std::filesystem::directory_iterator(tasks, error)) {
    std::string comm;
    std::getline(std::ifstream(entry.path() / "comm"), comm);
    if (comm == name) return std::stoi(entry.path().filename().string());
  }
  return -1;
}

}  // namespace waymark::testing
