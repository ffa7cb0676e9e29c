// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/program_lines.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <system_error>
#include <vector>

#include <fmt/format.h>

#include "core/files.hpp"

namespace maquette::cnc {
namespace {

constexpr std::size_t kChunk = std::size_t{1} << 22;

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};

struct Used {
  std::size_t bytes;
  bool enough;
};
/// Hands over all complete lines of `text`.
Result<Used> complete_lines(const ProgramLines::Line& line, std::string_view text) {
  std::size_t at = 0;
  while (at < text.size()) {
    const void* end = std::memchr(text.data() + at, '\n', text.size() - at);
    if (end == nullptr) break;
    const auto length =
        static_cast<std::size_t>(static_cast<const char*>(end) - (text.data() + at));
    MAQUETTE_TRY(const bool go_on, line(text.substr(at, length), true));
    at += length + 1;
    if (!go_on) return Used{at, true};
  }
  return Used{at, false};
}

}  // namespace

Result<std::uint64_t> ProgramLines::each(const Line& line) const {
  if (!file_.empty()) return each_of_file(line);
  MAQUETTE_TRY(const Used used, complete_lines(line, text_));
  if (!used.enough && used.bytes < text_.size())
    MAQUETTE_TRY_VOID(line(text_.substr(used.bytes), false));
  return text_.size();
}

Result<std::uint64_t> ProgramLines::each_of_file(const Line& line) const {
  std::error_code ec;
  if (!std::filesystem::exists(file_, ec))
    return fail(kFileNotFound,
                fmt::format("{}: no such file; expected a G-code program", file_.string()));
  const std::unique_ptr<std::FILE, CloseFile> file(std::fopen(file_.c_str(), "rb"));
  if (!file || std::filesystem::is_directory(file_, ec))
    return fail(kFileNotReadable,
                fmt::format("{}: cannot be read ({}); expected a G-code program", file_.string(),
                            file ? "it is a folder" : std::strerror(errno)));
  std::vector<char> buffer(kChunk);
  std::size_t held = 0;  // bytes of an unfinished line at the buffer's start
  std::uint64_t bytes = 0;
  for (;;) {
    const std::size_t got = std::fread(buffer.data() + held, 1, buffer.size() - held, file.get());
    if (got == 0 && std::ferror(file.get()) != 0)
      return fail(kFileNotReadable, fmt::format("{}: reading failed after {} bytes: {}",
                                                file_.string(), bytes, std::strerror(errno)));
    bytes += got;
    const std::string_view text(buffer.data(), held + got);
    MAQUETTE_TRY(const Used used, complete_lines(line, text));
    if (used.enough) return bytes;
    held = text.size() - used.bytes;
    if (got == 0 || held > kLongestLine) {  // the end, or a line that will be refused
      if (held > 0) MAQUETTE_TRY_VOID(line(text.substr(used.bytes), false));
      return bytes;
    }
    std::memmove(buffer.data(), buffer.data() + used.bytes, held);
  }
}

}  // namespace maquette::cnc
