// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/pipeline.hpp"

#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstring>
#include <fstream>
#include <optional>

#include <fcntl.h>
#include <fmt/format.h>
#include <malloc.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "tools/version.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

double cpu_seconds() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

/// Linux: writing 5 resets the high-water mark of the resident set, so that each
/// unit gets its own figure; where that is not allowed the mark only grows.
void reset_peak_memory() {
  ::malloc_trim(0);
  std::ofstream("/proc/self/clear_refs") << "5";
}

double peak_memory_mib() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("VmHWM:")) return std::strtod(line.c_str() + 6, nullptr) / 1024.0;
  return 0.0;
}

/// Another build of the program may give other results, whatever its version says.
const std::string& program_fingerprint() {
  static const std::string print = [] {
    const auto digest = sha256_file("/proc/self/exe");
    return fmt::format("{} {}", kVersion, digest ? *digest : "");
  }();
  return print;
}

std::optional<std::int64_t> modified_ns(const fs::path& path, std::uint64_t& bytes) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) return std::nullopt;
  bytes = static_cast<std::uint64_t>(info.st_size);
  return static_cast<std::int64_t>(info.st_mtim.tv_sec) * 1'000'000'000 + info.st_mtim.tv_nsec;
}

json to_json(const OutputRecord& o) {
  return {
      {"path", o.path}, {"sha256", o.sha256}, {"bytes", o.bytes}, {"modified_ns", o.modified_ns}};
}

OutputRecord output_from(const json& j) {
  return {j.at("path"), j.at("sha256"), j.at("bytes"), j.at("modified_ns")};
}

std::string to_text(const UnitRecord& r) {
  json j{{"name", r.name},     {"key", r.key},     {"figures", json::parse(r.figures_json)},
         {"note", r.note},     {"unmet", r.unmet}, {"parameters", json::parse(r.parameters_json)},
         {"wall_s", r.wall_s}, {"cpu_s", r.cpu_s}, {"peak_mib", r.peak_mib}};
  for (const auto& o : r.inputs) j["inputs"].push_back(to_json(o));
  for (const auto& o : r.outputs) j["outputs"].push_back(to_json(o));
  return j.dump(1);
}

/// A record that cannot be read counts as none: the unit is simply done again.
std::optional<UnitRecord> read_record(const fs::path& path) {
  const auto text = read_file(path);
  if (!text) return std::nullopt;
  try {
    const json j = json::parse(*text);
    UnitRecord r;
    r.name = j.at("name"), r.key = j.at("key"), r.note = j.at("note"), r.unmet = j.at("unmet");
    r.figures_json = j.at("figures").dump(), r.parameters_json = j.at("parameters").dump();
    r.wall_s = j.at("wall_s"), r.cpu_s = j.at("cpu_s"), r.peak_mib = j.at("peak_mib");
    for (const json& o : j.value("inputs", json::array())) r.inputs.push_back(output_from(o));
    for (const json& o : j.value("outputs", json::array())) r.outputs.push_back(output_from(o));
    return r;
  } catch (const json::exception&) {
    return std::nullopt;
  }
}

/// Left over by a run that was killed; only the holder of the exclusive lock may.
void remove_partial_files(const fs::path& folder) {
  std::error_code ec;
  for (auto it = fs::recursive_directory_iterator(folder, ec);
       !ec && it != fs::recursive_directory_iterator(); it.increment(ec))
    if (it->is_regular_file(ec) && it->path().filename().string().starts_with(".") &&
        it->path().filename().string().find(".partial-") != std::string::npos)
      fs::remove(it->path(), ec);
}

}  // namespace

Result<Shard> parse_shard(const std::string& text) {
  Shard shard;
  const char* const end = text.data() + text.size();
  const auto first = std::from_chars(text.data(), end, shard.index);
  const bool slash = first.ec == std::errc{} && first.ptr != end && *first.ptr == '/';
  const auto second = slash ? std::from_chars(first.ptr + 1, end, shard.count) : first;
  if (!slash || second.ec != std::errc{} || second.ptr != end || shard.index < 1 ||
      shard.count < 1 || shard.index > shard.count)
    return fail(kShardRange,
                fmt::format("--shard {}: expected i/n with 1 <= i <= n, for example 2/4", text));
  --shard.index;
  return shard;
}

Pipeline::Pipeline(fs::path folder, int lock, Console& console)
    : folder_(std::move(folder)), lock_(lock), console_(&console) {}

Pipeline::Pipeline(Pipeline&& other) noexcept
    : folder_(std::move(other.folder_)),
      lock_(std::exchange(other.lock_, -1)),
      console_(other.console_),
      records_(std::move(other.records_)),
      known_(std::move(other.known_)) {}

Pipeline::~Pipeline() {
  if (lock_ >= 0) ::close(lock_);  // closing gives the lock back
}

Result<Pipeline> Pipeline::open(const fs::path& folder, bool shared, Console& console) {
  std::error_code ec;
  fs::create_directories(folder / ".maquette", ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  const fs::path lock_path = folder / ".maquette" / "lock";
  const int fd = ::open(lock_path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd < 0) return tl::unexpected(write_error(lock_path, errno));
  if (::flock(fd, (shared ? LOCK_SH : LOCK_EX) | LOCK_NB) != 0) {
    std::string holder(32, '\0');
    const ssize_t n = ::pread(fd, holder.data(), holder.size(), 0);
    holder.resize(n > 0 ? static_cast<std::size_t>(n) : 0);
    ::close(fd);
    return fail(
        kDirectoryBusy,
        fmt::format("{}: another maquette run{} works in this folder; wait for it or choose "
                    "another --out",
                    folder.string(), holder.empty() ? "" : fmt::format(" (process {})", holder)));
  }
  if (!shared) {
    const std::string pid = fmt::format("{}", ::getpid());
    if (::ftruncate(fd, 0) != 0 ||
        ::pwrite(fd, pid.data(), pid.size(), 0) != static_cast<ssize_t>(pid.size())) {
      const int number = errno;
      ::close(fd);
      return tl::unexpected(write_error(lock_path, number));
    }
    remove_partial_files(folder);
  }
  return Pipeline(folder, fd, console);
}

Result<OutputRecord> Pipeline::fingerprint(const fs::path& path) {
  OutputRecord record;
  record.path = path.lexically_relative(folder_).string();
  if (record.path.empty() || record.path.starts_with("..")) record.path = path.string();
  const auto modified = modified_ns(path, record.bytes);
  if (!modified)
    return fail(kInputMissing,
                fmt::format("{}: is not there; run the stage that makes it first", path.string()));
  record.modified_ns = *modified;
  const auto known = known_.find(record.path);
  if (known != known_.end() && known->second.bytes == record.bytes &&
      known->second.modified_ns == record.modified_ns)
    return known->second;
  MAQUETTE_TRY(record.sha256, sha256_file(path));
  known_[record.path] = record;
  return record;
}

bool Pipeline::up_to_date(const UnitRecord& record) const {
  for (const OutputRecord& o : record.outputs) {
    const fs::path path = folder_ / o.path;
    std::uint64_t bytes = 0;
    const auto modified = modified_ns(path, bytes);
    if (!modified || bytes != o.bytes) return false;
    if (*modified != o.modified_ns) {
      // Copied to another machine, perhaps: the content decides.
      const auto digest = sha256_file(path);
      if (!digest || *digest != o.sha256) return false;
    }
  }
  return true;
}

Result<void> Pipeline::run(const Stage& stage, Shard shard) {
  for (std::size_t i = 0; i < stage.units.size(); ++i) {
    if (i % shard.count != shard.index) continue;
    const Unit& unit = stage.units[i];
    UnitRecord record;
    record.name = unit.name;
    record.parameters_json = unit.parameters_json;
    std::string identity =
        fmt::format("{}\n{}\n{}\n", program_fingerprint(), unit.name, unit.parameters_json);
    for (const fs::path& input : unit.inputs) {
      auto print = fingerprint(input);
      if (!print) return tl::unexpected(std::move(print.error()).within(unit.name));
      identity += print->sha256 + "\n";
      record.inputs.push_back(*std::move(print));
    }
    record.key = sha256(identity);

    const fs::path record_path = folder_ / ".maquette" / (unit.name + ".json");
    if (auto old = read_record(record_path); old && old->key == record.key && up_to_date(*old)) {
      for (const OutputRecord& o : old->outputs) {
        OutputRecord now = o;
        if (const auto m = modified_ns(folder_ / o.path, now.bytes)) now.modified_ns = *m;
        known_[o.path] = now;
      }
      old->reused = true;
      records_.push_back(*std::move(old));
      continue;
    }

    reset_peak_memory();
    const auto wall = std::chrono::steady_clock::now();
    const double cpu = cpu_seconds();
    const RunContext run = console_->begin(unit.name);
    auto done = unit.work(run);
    if (!done) {
      console_->end("failed");
      return tl::unexpected(std::move(done.error()).within(unit.name));
    }
    record.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - wall).count();
    record.cpu_s = cpu_seconds() - cpu;
    record.peak_mib = peak_memory_mib();
    record.figures_json = done->figures_json;
    record.note = done->note;
    record.unmet = done->unmet;
    for (const fs::path& output : done->outputs) {
      MAQUETTE_TRY(auto print, fingerprint(output));
      record.outputs.push_back(std::move(print));
    }
    MAQUETTE_TRY_VOID(write_file(record_path, to_text(record)));
    console_->end(record.note);
    records_.push_back(std::move(record));
  }
  return {};
}

}  // namespace maquette::tools
