// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/files.hpp"

#include <array>
#include <cerrno>
#include <cstring>
#include <system_error>

#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/evp.h>
#include <unistd.h>

namespace maquette {
namespace fs = std::filesystem;
namespace {

/// Same folder (rename must not cross file systems), same extension (libraries
/// choose the format by it), one name per process (two processes never share it).
fs::path partial_name(const fs::path& final_path) {
  return final_path.parent_path() / fmt::format(".{}.partial-{}{}", final_path.stem().string(),
                                                ::getpid(), final_path.extension().string());
}

Result<void> rename_into_place(const fs::path& partial, const fs::path& final_path) {
  if (::rename(partial.c_str(), final_path.c_str()) != 0)
    return tl::unexpected(write_error(final_path, errno));
  return {};
}

struct DigestDeleter {
  void operator()(EVP_MD_CTX* c) const { EVP_MD_CTX_free(c); }
};
using Digest = std::unique_ptr<EVP_MD_CTX, DigestDeleter>;

Digest start_digest() {
  Digest d(EVP_MD_CTX_new());
  EVP_DigestInit_ex(d.get(), EVP_sha256(), nullptr);
  return d;
}

std::string finish_digest(EVP_MD_CTX* d) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> bytes{};
  unsigned int length = 0;
  EVP_DigestFinal_ex(d, bytes.data(), &length);
  std::string hex;
  for (unsigned int i = 0; i < length; ++i) hex += fmt::format("{:02x}", bytes[i]);
  return hex;
}

}  // namespace

Error write_error(const fs::path& path, int number) {
  if (number == ENOSPC || number == EDQUOT || number == EFBIG)
    return {kDiskFull, fmt::format("{}: the disk is full ({}); free space or choose another --out",
                                   path.string(), std::strerror(number))};
  return {kFileNotWritable,
          fmt::format("{}: cannot write ({}); check that the folder exists and may be written",
                      path.string(), std::strerror(number))};
}

struct AtomicFile::State {
  fs::path final_path, partial;
  std::FILE* file = nullptr;
  int error = 0;
  bool renamed = false;
  ~State() {
    if (file != nullptr) std::fclose(file);
    if (!renamed) ::unlink(partial.c_str());
  }
};

AtomicFile::AtomicFile(std::unique_ptr<State> state) : state_(std::move(state)) {}
AtomicFile::AtomicFile(AtomicFile&&) noexcept = default;
AtomicFile& AtomicFile::operator=(AtomicFile&&) noexcept = default;
AtomicFile::~AtomicFile() = default;

Result<AtomicFile> AtomicFile::create(const fs::path& final_path) {
  auto state = std::make_unique<State>();
  state->final_path = final_path;
  state->partial = partial_name(final_path);
  state->file = std::fopen(state->partial.c_str(), "wb");
  if (state->file == nullptr) {
    state->renamed = true;  // there is nothing to remove
    return tl::unexpected(write_error(final_path, errno));
  }
  std::setvbuf(state->file, nullptr, _IOFBF, std::size_t{1} << 20);
  return AtomicFile(std::move(state));
}

void AtomicFile::write(const void* data, std::size_t bytes) {
  if (state_->error == 0 && std::fwrite(data, 1, bytes, state_->file) != bytes)
    state_->error = errno != 0 ? errno : EIO;
}

void AtomicFile::rewrite(std::uint64_t offset, std::string_view bytes) {
  State& s = *state_;
  if (s.error == 0 && ::fseeko(s.file, static_cast<off_t>(offset), SEEK_SET) != 0) s.error = errno;
  write(bytes);
  if (s.error == 0 && ::fseeko(s.file, 0, SEEK_END) != 0) s.error = errno;
}

Result<void> AtomicFile::close() {
  State& s = *state_;
  if (s.file != nullptr) {
    if (s.error == 0 && std::fflush(s.file) != 0) s.error = errno;
    if (s.error == 0 && ::fsync(::fileno(s.file)) != 0 && errno != EINVAL) s.error = errno;
    if (std::fclose(s.file) != 0 && s.error == 0) s.error = errno;
    s.file = nullptr;
  }
  if (s.error != 0) return tl::unexpected(write_error(s.final_path, s.error));
  return {};
}

Result<void> AtomicFile::commit() {
  State& s = *state_;
  MAQUETTE_TRY_VOID(close());
  MAQUETTE_TRY_VOID(rename_into_place(s.partial, s.final_path));
  s.renamed = true;
  return {};
}

AtomicPath::AtomicPath(fs::path final_path)
    : final_(std::move(final_path)), partial_(partial_name(final_)) {}

AtomicPath::~AtomicPath() {
  std::error_code ignored;
  if (!committed_) fs::remove(partial_, ignored);
}

Result<void> AtomicPath::prepare() const {
  std::FILE* f = std::fopen(partial_.c_str(), "wb");
  if (f == nullptr) return tl::unexpected(write_error(final_, errno));
  std::fclose(f);
  return {};
}

Result<void> AtomicPath::commit() {
  // A library that does not check its own writes leaves a short file on a full
  // disk; asking the system to store it now brings the error out.
  const int fd = ::open(partial_.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return tl::unexpected(write_error(final_, errno));
  const int failed = ::fsync(fd) != 0 && errno != EINVAL ? errno : 0;
  ::close(fd);
  if (failed != 0) return tl::unexpected(write_error(final_, failed));
  MAQUETTE_TRY_VOID(rename_into_place(partial_, final_));
  committed_ = true;
  return {};
}

Result<void> write_file(const fs::path& path, std::string_view content) {
  MAQUETTE_TRY(auto file, AtomicFile::create(path));
  file.write(content);
  return file.commit();
}

Result<std::string> read_file(const fs::path& path, std::size_t limit_bytes) {
  std::error_code ec;
  const auto status = fs::status(path, ec);
  if (!fs::exists(status))
    return fail(kFileNotFound, fmt::format("{}: no such file", path.string()));
  if (fs::is_directory(status))
    return fail(kFileNotReadable,
                fmt::format("{}: is a folder, a file was expected", path.string()));
  const auto size = fs::file_size(path, ec);
  if (!ec && size > limit_bytes)
    return fail(kFileTooLarge,
                fmt::format("{}: {} bytes, at most {} expected", path.string(), size, limit_bytes));
  std::FILE* f = std::fopen(path.c_str(), "rb");
  if (f == nullptr)
    return fail(kFileNotReadable,
                fmt::format("{}: cannot read ({})", path.string(), std::strerror(errno)));
  std::string content;
  std::array<char, 1 << 16> buffer{};
  std::size_t n = 0;
  while ((n = std::fread(buffer.data(), 1, buffer.size(), f)) > 0) content.append(buffer.data(), n);
  const bool bad = std::ferror(f) != 0;
  std::fclose(f);
  if (bad) return fail(kFileNotReadable, fmt::format("{}: reading failed", path.string()));
  return content;
}

std::string sha256(std::string_view data) {
  const Digest d = start_digest();
  EVP_DigestUpdate(d.get(), data.data(), data.size());
  return finish_digest(d.get());
}

Result<std::string> sha256_file(const fs::path& path) {
  std::FILE* f = std::fopen(path.c_str(), "rb");
  if (f == nullptr)
    return fail(errno == ENOENT ? kFileNotFound : kFileNotReadable,
                fmt::format("{}: cannot read ({})", path.string(), std::strerror(errno)));
  const Digest d = start_digest();
  std::string buffer(std::size_t{1} << 20, '\0');
  std::size_t n = 0;
  while ((n = std::fread(buffer.data(), 1, buffer.size(), f)) > 0)
    EVP_DigestUpdate(d.get(), buffer.data(), n);
  const bool bad = std::ferror(f) != 0;
  std::fclose(f);
  if (bad) return fail(kFileNotReadable, fmt::format("{}: reading failed", path.string()));
  return finish_digest(d.get());
}

}  // namespace maquette
