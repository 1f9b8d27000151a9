#include "revisit/engine/parallel_for.h"

#include <linux/futex.h>
#include <pthread.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <climits>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include "kernels/float_mode.h"
#include "layout.h"

namespace revisit::engine {
namespace {

/// Forks that this process descends from. Threads that are older do not exist in it.
std::atomic<int> forks = 0;
[[maybe_unused]] const bool kForksAreCounted =
    ::pthread_atfork(nullptr, nullptr, [] { ++forks; }) == 0;

void relax() {
#ifdef __x86_64__
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

/// A number that threads wait on. std::atomic::wait() would yield the processor before it sleeps:
/// beside other programs that costs a time slice.
class alignas(64) Signal {
 public:
  std::atomic<uint32_t> value = 0;

  /// Returns when the value is no longer `seen`, or for no reason. Loops for 20 us, about the time
  /// to wake a thread, and then sleeps.
  void await_change(uint32_t seen) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::microseconds(20);
    do {
      for (int i = 0; i < 16; ++i) {
        if (value.load(std::memory_order_acquire) != seen) return;
        relax();
      }
    } while (std::chrono::steady_clock::now() < end);
    ++sleepers_;
    ::syscall(SYS_futex, &value, FUTEX_WAIT_PRIVATE, seen, nullptr);
    --sleepers_;
  }
  /// After a change of the value, which must be sequentially consistent.
  void wake() {
    if (sleepers_ > 0) ::syscall(SYS_futex, &value, FUTEX_WAKE_PRIVATE, INT_MAX);
  }

 private:
  std::atomic<uint32_t> sleepers_ = 0;
};

/// Whether this thread works in a region, as caller or helper. Regions within it run on it alone.
thread_local bool in_region = false;

/// Threads that help one calling thread. A helper that is not scheduled costs nothing: the caller
/// waits only for helpers that have entered the region.
class Team {
 public:
  using Work = void (*)(const void* object, int thread);
  static constexpr int kMaxThreads = 1024;

  Team() = default;
  ~Team() {
    stop_ = true;
    announce();
    for (std::thread& helper : helpers_) helper.join();
  }
  Team(const Team&) = delete;
  Team& operator=(const Team&) = delete;

  bool exists_here() const { return forks_ == forks; }

  /// Calls `work(object, thread)` for thread 0 on this thread. The helpers 1 to `threads` - 1 call
  /// it if they come before the caller returns from that.
  void run(int threads, Work work, const void* object) {
    add_helpers(threads - 1);
    work_ = work;
    object_ = object;
    door_.value = kOpen | static_cast<uint32_t>(threads) << kThreadsShift;
    announce();
    work(object, 0);
    door_.value &= kInside;
    while (const uint32_t inside = door_.value) door_.await_change(inside);
  }

 private:
  /// With fewer threads than wanted if the system refuses more.
  void add_helpers(int wanted) try {
    while (static_cast<int>(helpers_.size()) < wanted) {
      const auto thread = static_cast<uint32_t>(helpers_.size() + 1);
      helpers_.emplace_back([this, thread] { help(thread); });
    }
  } catch (const std::exception&) {
  }

  void announce() {
    ++news_.value;
    news_.wake();
  }

  bool enter(uint32_t thread) {
    uint32_t door = door_.value;
    while ((door & kOpen) && thread < (door & ~kOpen) >> kThreadsShift)
      if (door_.value.compare_exchange_weak(door, door + 1)) return true;
    return false;
  }

  void help(uint32_t thread) {
    in_region = true;
    for (uint32_t seen = 0; !stop_;) {
      if (news_.value == seen) {
        news_.await_change(seen);
        continue;
      }
      seen = news_.value;
      if (!enter(thread)) continue;
      work_(object_, static_cast<int>(thread));
      if (--door_.value == 0) door_.wake();
    }
  }

  /// Bits of door_: open to helpers below the number of threads; how many are inside.
  static constexpr uint32_t kOpen = 1U << 31, kInside = 0xFFFF, kThreadsShift = 16;

  std::vector<std::thread> helpers_;  // helper i is thread i + 1
  const int forks_ = forks;
  Work work_ = nullptr;  // of the region, read by helpers inside
  const void* object_ = nullptr;
  std::atomic<bool> stop_ = false;
  Signal news_;  // counts regions
  Signal door_;
};

/// Null before the first region of this thread, and while it ends.
thread_local Team* team = nullptr;

void run_in_team(int threads, Team::Work work, const void* object) {
  thread_local bool ended = false;
  struct EndsTeam {
    ~EndsTeam() {
      if (team && team->exists_here()) delete team;
      team = nullptr;
      ended = true;
    }
  };
  if (in_region || ended) return work(object, 0);
  thread_local const EndsTeam kAtEndOfThread;
  static_cast<void>(&kAtEndOfThread);
  // A forked child leaves the team to its parent: its threads can neither end nor be joined here.
  if (!team || !team->exists_here()) team = new Team;
  in_region = true;
  team->run(threads, work, object);
  in_region = false;
}

/// Items of a region: each thread has a range of its own and then takes what others have left.
class Items {
 public:
  Items(int64_t items, int threads, void (*work)(const void*, int64_t, int), const void* object)
      : items_(items),
        parts_(std::min<int64_t>(threads, kMaxRanges)),
        work_(work),
        object_(object),
        failed_(items) {
    for (int64_t i = 0; i < parts_; ++i) own_[i].next = Split{items, parts_}.begin(i);
  }

  void take(int thread) {
    const FloatModeScope scope(mode_);
    for (int64_t i = 0; i < parts_; ++i) {
      const int64_t range = (thread + i) % parts_;
      const int64_t end = Split{items_, parts_}.end(range);
      std::atomic<int64_t>& next = own_[range].next;
      for (int64_t item; (item = next.fetch_add(1, std::memory_order_relaxed)) < end;) {
        if (item > failed_.load(std::memory_order_relaxed)) break;
        try {
          work_(object_, item, thread);
        } catch (...) {
          keep_lowest(item, std::current_exception());
        }
      }
    }
  }

  void rethrow() const {
    if (error_) std::rethrow_exception(error_);
  }

 private:
  void keep_lowest(int64_t item, std::exception_ptr error) {
    const std::scoped_lock lock(mutex_);
    if (item > failed_) return;
    failed_ = item;
    error_ = std::move(error);
  }

  static constexpr int kMaxRanges = 64;  // further threads share them
  struct alignas(64) Range {             // one cache line each
    std::atomic<int64_t> next;
  };
  const int64_t items_, parts_;
  void (*const work_)(const void*, int64_t, int);
  const void* const object_;
  const FloatMode mode_ = FloatMode::current();
  std::array<Range, kMaxRanges> own_;
  std::atomic<int64_t> failed_;  // lowest item that threw
  std::exception_ptr error_;
  std::mutex mutex_;
};

}  // namespace

void share_items(int64_t items, int threads,
                 void (*work)(const void* object, int64_t item, int thread), const void* object) {
  if (items <= 1) {
    if (items == 1) work(object, 0, 0);
    return;
  }
  const int used = static_cast<int>(std::min<int64_t>({items, threads, Team::kMaxThreads}));
  Items shared(items, used, work, object);
  run_in_team(
      used,
      [](const void* region, int thread) {
        static_cast<Items*>(const_cast<void*>(region))->take(thread);
      },
      &shared);
  shared.rethrow();
}

}  // namespace revisit::engine
