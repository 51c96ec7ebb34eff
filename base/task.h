// Work in slices. A task is written as if it were done in one go, and is put aside whenever it has
// spent what it was given, to go on from there the next time:
//
//   Task<int> sum(std::span<const int> values, Budget* budget) {
//     int total = 0;
//     for (const int value : values) {
//       co_await budget->spend(kAddition);
//       total += value;
//     }
//     co_return total;
//   }
//
// What it spends is counted, not timed: the same work is cut into the same slices everywhere.
#pragma once

#include <coroutine>
#include <exception>
#include <limits>
#include <optional>
#include <utility>

namespace waymark {

// What tasks may spend, in units of their own choice. Everything that belongs to one task, and the
// tasks it waits for, spends from the same budget, which outlives them.
class Budget {
 public:
  // As much as it takes.
  [[nodiscard]] static Budget unlimited() {
    Budget budget;
    budget.left_ = std::numeric_limits<double>::infinity();
    return budget;
  }

  // What was overspent last time is owed now; what was left is lost.
  void grant(double cost) { left_ = (left_ < 0.0 ? left_ : 0.0) + cost; }
  [[nodiscard]] double left() const { return left_; }

  struct Spending {
    Budget* budget;
    [[nodiscard]] bool await_ready() const { return budget->left_ > 0.0; }
    void await_suspend(std::coroutine_handle<> where) const { budget->waiting_ = where; }
    void await_resume() const {}
  };
  // Puts the task aside where nothing is left, before it does what these units are for.
  [[nodiscard]] Spending spend(double cost) {
    left_ -= cost;
    return {this};
  }

  // Goes on where the task was put aside, if there is anything left.
  void resume() {
    if (waiting_ && left_ > 0.0) std::exchange(waiting_, nullptr).resume();
  }

 private:
  double left_ = 0.0;
  std::coroutine_handle<> waiting_;
};

// Of a task that has nothing to tell.
struct Done {};

// Begins when it is awaited, by another task or through SlicedTask or runToCompletion below.
// Arguments that a task takes by reference or pointer must outlive it.
template <typename T>
class [[nodiscard]] Task {
 public:
  struct promise_type {  // NOLINT(readability-identifier-naming): the language asks for that name
    std::optional<T> value;
    std::coroutine_handle<> parent = std::noop_coroutine();

    Task get_return_object() {
      return Task(std::coroutine_handle<promise_type>::from_promise(*this));
    }
    std::suspend_always initial_suspend() noexcept { return {}; }
    struct GoOnWithParent {
      bool await_ready() noexcept { return false; }
      std::coroutine_handle<> await_suspend(std::coroutine_handle<promise_type> done) noexcept {
        return done.promise().parent;
      }
      void await_resume() noexcept {}
    };
    GoOnWithParent final_suspend() noexcept { return {}; }
    void return_value(T result) { value = std::move(result); }
    void unhandled_exception() { std::terminate(); }  // only memory can run out
  };

  Task(Task&& other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Task& operator=(Task&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }
  Task(const Task&) = delete;
  Task& operator=(const Task&) = delete;
  ~Task() {
    if (handle_) handle_.destroy();
  }

  // For co_await in another task.
  [[nodiscard]] bool await_ready() const { return false; }
  std::coroutine_handle<> await_suspend(std::coroutine_handle<> parent) {
    handle_.promise().parent = parent;
    return handle_;
  }
  T await_resume() { return take(); }

  void begin() { handle_.resume(); }
  [[nodiscard]] bool done() const { return handle_.done(); }
  // Precondition: done, and not taken before.
  T take() { return std::move(*handle_.promise().value); }

 private:
  explicit Task(std::coroutine_handle<promise_type> handle) : handle_(handle) {}
  std::coroutine_handle<promise_type> handle_;
};

// More than any task needs, and yet a number: what is left of it can be handed on.
inline constexpr double kUnlimited = 1e12;

// A task under way, with a budget of its own.
template <typename T>
class SlicedTask {
 public:
  // begin(budget) gives the task.
  template <typename Begin>
  explicit SlicedTask(const Begin& begin) : task_(begin(&budget_)) {}
  SlicedTask(const SlicedTask&) = delete;
  SlicedTask& operator=(const SlicedTask&) = delete;
  ~SlicedTask() = default;

  // One slice; true when the task is done, and then nothing more happens.
  bool advance(double cost) {
    if (task_.done()) return true;
    budget_.grant(cost);
    if (!begun_) {
      begun_ = true;
      task_.begin();
    } else {
      budget_.resume();
    }
    return task_.done();
  }
  [[nodiscard]] bool done() const { return task_.done(); }
  // Of the last slice; less than zero where it was overspent.
  [[nodiscard]] double left() const { return budget_.left(); }
  // Precondition: done, and not taken before.
  T take() { return task_.take(); }

 private:
  Budget budget_;
  Task<T> task_;
  bool begun_ = false;
};

// begin(budget) gives the task.
template <typename Begin>
auto runToCompletion(const Begin& begin) {
  Budget budget = Budget::unlimited();
  auto task = begin(&budget);
  task.begin();
  return task.take();
}

}  // namespace waymark
