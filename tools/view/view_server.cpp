// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/view/view_server.hpp"

#include <bit>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <httplib.h>
#include <sys/socket.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include "tools/view/view_contents.hpp"
#include "tools/view/view_fields.hpp"
#include "tools/view/view_files.hpp"
#include "tools/view/view_picture.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using httplib::Request;
using httplib::Response;
namespace {

constexpr const char* kLoopback = "127.0.0.1";
constexpr std::size_t kMostPlaces = 20'000;           // of a profile
constexpr double kMostIndex = 1e6, kMostQuads = 512;  // of a tile
constexpr int kMostNodes = 4096;                      // a side of a grid

// The decoders are WebAssembly in workers that are made of text.
constexpr const char* kPolicy =
    "default-src 'self'; script-src 'self' 'wasm-unsafe-eval' blob:; worker-src 'self' blob:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' blob: data:; connect-src 'self' blob: data:; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

void say(Response& response, int status, const std::string& text) {
  response.status = status;
  response.set_content(nlohmann::json{{"error", text}}.dump(
                           -1, ' ', false, nlohmann::json::error_handler_t::replace),
                       "application/json");
}

/// True if the asked ranges are all within the content; else the answer is 416 already.
bool ranges_fit(const Request& request, Response& response, std::size_t size) {
  const auto whole = static_cast<ssize_t>(size);
  for (const auto& [first, last] : request.ranges) {  // -1: left open
    const bool suffix = first < 0;
    if (suffix ? (last <= 0 || whole == 0) : (first >= whole || (last >= 0 && last < first))) {
      // The library would cut what we say here by the range that does not fit.
      const_cast<Request&>(request).ranges.clear();
      response.set_header("Content-Range", fmt::format("bytes */{}", size));
      say(response, 416, fmt::format("there are {} bytes", size));
      return false;
    }
  }
  // More than there is means all that there is.
  for (auto& [first, last] : const_cast<Request&>(request).ranges)
    last = std::min(last, first < 0 ? whole : whole - 1);
  return true;
}

/// Content with a known length: the library neither copies nor compresses it.
void give_bytes(const Request& request, Response& response,
                std::shared_ptr<const std::string> bytes, const char* type) {
  if (!ranges_fit(request, response, bytes->size())) return;
  if (bytes->empty()) {
    response.set_content("", type);
    return;
  }
  response.set_content_provider(
      bytes->size(), type,
      [bytes](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
        return sink.write(bytes->data() + offset, length);
      });
}

void give_file(const Request& request, Response& response, const fs::path& file) {
  const std::shared_ptr<std::FILE> open(
      std::fopen(file.c_str(), "rb"), [](std::FILE* f) { return f == nullptr || !std::fclose(f); });
  std::error_code ec;
  const std::size_t size = fs::file_size(file, ec);
  if (!open || ec) return say(response, 403, "cannot be read");
  if (!ranges_fit(request, response, size)) return;
  if (size == 0) {
    response.set_content("", mime_type(file));
    return;
  }
  response.set_content_provider(
      size, mime_type(file),
      [open](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
        std::vector<char> part(std::min<std::size_t>(length, 1 << 18));
        const ssize_t n =
            ::pread(::fileno(open.get()), part.data(), part.size(), static_cast<off_t>(offset));
        return n > 0 && sink.write(part.data(), static_cast<std::size_t>(n));
      });
}

std::optional<double> number(const std::string& text) {
  try {
    std::size_t end = 0;
    const double v = std::stod(text, &end);
    return end == text.size() && std::isfinite(v) ? std::optional(v) : std::nullopt;
  } catch (const std::exception&) {
    return std::nullopt;
  }
}

std::optional<Vec3> place(const std::string& text) {
  const std::size_t comma = text.find(',');
  if (comma == std::string::npos) return std::nullopt;
  const auto x = number(text.substr(0, comma)), y = number(text.substr(comma + 1));
  return x && y ? std::optional(Vec3{*x, *y, 0.0}) : std::nullopt;
}

std::optional<std::size_t> count(const std::string& text, double least, double most) {
  const auto v = number(text);
  return v && *v >= least && *v <= most && std::floor(*v) == *v
             ? std::optional(static_cast<std::size_t>(*v))
             : std::nullopt;
}

}  // namespace

struct ViewServer::State {
  fs::path folder;
  int port = 0;
  std::span<const PageFile> page;
  FieldShelf shelf;
  httplib::Server server;
  std::thread thread;

  ~State() {
    server.stop();
    if (thread.joinable()) thread.join();
  }

  [[nodiscard]] bool host_is_ours(const Request& request) const {
    if (request.get_header_value_count("Host") != 1) return false;
    const std::string host = request.get_header_value("Host");
    return host == fmt::format("{}:{}", kLoopback, port) ||
           host == fmt::format("localhost:{}", port);
  }

  void give_page(const Request& request, Response& response) const {
    const std::string_view name = request.path == "/" ? std::string_view("index.html")
                                                      : std::string_view(request.path).substr(1);
    for (const PageFile& file : page)
      if (file.name == name) {
        response.set_header("Content-Security-Policy", kPolicy);
        // An owner that does nothing: the bytes live as long as the program.
        return give_bytes(request, response, std::make_shared<const std::string>(file.bytes),
                          mime_type(fs::path(name)));
      }
    say(response, 404, "no such page");
  }

  /// The raster that a query names; else the answer is given already.
  std::shared_ptr<const heightmap::ModelField> field_of(const Request& request,
                                                        Response& response) {
    const std::string name = request.get_param_value("file");
    const auto file = file_below(folder, name);
    if (!file) {
      say(response, 404, fmt::format("{}: no such file", name));
      return nullptr;
    }
    auto field = shelf.get(*file);
    if (!field) {
      say(response, 422, field.error().message);
      return nullptr;
    }
    return *field;
  }

  void give_grid(const Request& request, Response& response) {
    const auto nodes = count(request.get_param_value("nodes"), 2, kMostNodes);
    if (!nodes) return say(response, 400, fmt::format("nodes: 2 to {}", kMostNodes));
    const auto field = field_of(request, response);
    if (!field) return;
    static_assert(std::endian::native == std::endian::little);
    const ThinnedField thin = thinned(*field, static_cast<std::ptrdiff_t>(*nodes),
                                      request.get_param_value("mean") == "1");
    response.set_header("Maquette-Grid", thin.shape_json());
    give_bytes(
        request, response,
        std::make_shared<const std::string>(reinterpret_cast<const char*>(thin.values.data()),
                                            thin.values.size() * sizeof(float)),
        "application/octet-stream");
  }

  void give_tile(const Request& request, Response& response) {
    const auto whole = [&](const char* name, double least, double most) {
      return count(request.get_param_value(name), least, most);
    };
    const auto row = whole("row", 0, kMostIndex), col = whole("col", 0, kMostIndex),
               every = whole("every", 1, kMostIndex), quads = whole("quads", 1, kMostQuads);
    if (!row || !col || !every || !quads)
      return say(
          response, 400,
          fmt::format("row, col, every and quads (at most {:g}) are whole numbers", kMostQuads));
    const auto field = field_of(request, response);
    if (!field) return;
    const auto n = [](std::size_t v) { return static_cast<std::ptrdiff_t>(v); };
    const std::vector<float> values = every_nth(*field, n(*row), n(*col), n(*every), n(*quads));
    give_bytes(request, response,
               std::make_shared<const std::string>(reinterpret_cast<const char*>(values.data()),
                                                   values.size() * sizeof(float)),
               "application/octet-stream");
  }

  void give_profile(const Request& request, Response& response) {
    const auto from = place(request.get_param_value("from")),
               to = place(request.get_param_value("to"));
    const auto places =
        count(request.get_param_value("count"), 1, static_cast<double>(kMostPlaces));
    if (!from || !to || !places)
      return say(response, 400,
                 fmt::format("from=X,Y&to=X,Y&count=N, mm, N from 1 to {}", kMostPlaces));
    const auto field = field_of(request, response);
    if (!field) return;
    // What is not a number becomes null.
    const nlohmann::json values{{"values", profile_of(*field, *from, *to, *places)}};
    give_bytes(request, response, std::make_shared<const std::string>(values.dump()),
               "application/json");
  }

  void give_picture(const Request& request, Response& response) const {
    const auto most = count(request.get_param_value("most"), 1, kMostNodes);
    if (!most) return say(response, 400, fmt::format("most: 1 to {}", kMostNodes));
    const std::string name = request.get_param_value("file");
    const auto file = file_below(folder, name);
    if (!file) return say(response, 404, fmt::format("{}: no such file", name));
    auto png =
        picture_png(*file, request.get_param_value("linear") == "1", static_cast<int>(*most));
    if (!png) return say(response, 422, png.error().message);
    response.set_header("Cache-Control", "no-cache");
    give_bytes(request, response, std::make_shared<const std::string>(std::move(*png)),
               "image/png");
  }

  void give_contents(const Request& request, Response& response) const {
    auto contents = view_contents_json(folder);
    if (!contents) return say(response, 404, contents.error().message);
    response.set_header("Cache-Control", "no-store");
    give_bytes(request, response, std::make_shared<const std::string>(std::move(*contents)),
               "application/json");
  }

  void set_up() {
    // No SO_REUSEPORT, the library's default: a second program would share our port in silence.
    server.set_socket_options([](int socket) {
      const int yes = 1;
      ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    });
    server.set_tcp_nodelay(true);
    server.set_payload_max_length(1 << 16);
    server.set_keep_alive_max_count(100'000);
    constexpr std::size_t kThreads = 24;  // a browser keeps six connections a tab open
    server.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
    server.set_default_headers({{"X-Content-Type-Options", "nosniff"},
                                {"Cross-Origin-Resource-Policy", "same-origin"},
                                {"Referrer-Policy", "no-referrer"}});
    server.set_pre_routing_handler([this](const Request& request, Response& response) {
      using Handled = httplib::Server::HandlerResponse;
      if (!host_is_ours(request)) {
        say(response, 403, fmt::format("ask for http://{}:{}/", kLoopback, port));
        return Handled::Handled;
      }
      if (request.method != "GET" && request.method != "HEAD") {
        say(response, 405, "nothing can be changed here");
        return Handled::Handled;
      }
      return Handled::Unhandled;
    });
    server.set_exception_handler([](const Request&, Response& response, std::exception_ptr) {
      say(response, 500, "a bug of maquette view");
    });
    server.Get("/maquette.json",
               [this](const Request& q, Response& r) { return give_contents(q, r); });
    server.Get("/grid", [this](const Request& q, Response& r) { return give_grid(q, r); });
    server.Get("/tile", [this](const Request& q, Response& r) { return give_tile(q, r); });
    server.Get("/picture", [this](const Request& q, Response& r) { return give_picture(q, r); });
    server.Get("/profile", [this](const Request& q, Response& r) { return give_profile(q, r); });
    server.Get("/files/(.*)", [this](const Request& q, Response& r) {
      const auto file = file_below(folder, std::string_view(q.path).substr(7));
      if (!file) return say(r, 404, "no such file");
      r.set_header("Cache-Control", "no-cache");
      return give_file(q, r, *file);
    });
    server.Get("/.*", [this](const Request& q, Response& r) { return give_page(q, r); });
  }
};

ViewServer::ViewServer(std::unique_ptr<State> state) : state_(std::move(state)) {}
ViewServer::ViewServer(ViewServer&&) noexcept = default;
ViewServer& ViewServer::operator=(ViewServer&&) noexcept = default;
ViewServer::~ViewServer() = default;
int ViewServer::port() const {
  return state_->port;
}

namespace {

/// What the system says to the port; the library keeps it to itself.
std::string why_not(int port) {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_port = htons(static_cast<std::uint16_t>(port));
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const int yes = 1;
  ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  const bool bound = ::bind(socket, reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0;
  const std::string why = bound ? "cannot be listened on" : std::strerror(errno);
  ::close(socket);
  return why;
}

}  // namespace

Result<ViewServer> ViewServer::start(const fs::path& folder, int port,
                                     std::span<const PageFile> page) {
  MAQUETTE_TRY([[maybe_unused]] const std::string contents, view_contents_json(folder));
  auto state = std::make_unique<State>();
  std::error_code ec;
  state->folder = fs::canonical(folder, ec);
  state->page = page;
  state->set_up();
  if (port == 0)
    state->port = state->server.bind_to_any_port(kLoopback);
  else
    state->port = state->server.bind_to_port(kLoopback, port) ? port : -1;
  if (state->port <= 0)
    return fail(kPortTaken,
                fmt::format("port {} of {}: {}; end the program that uses it, or choose another "
                            "with --port (0: any that is free)",
                            port, kLoopback, why_not(port)));
  state->thread = std::thread([server = &state->server] { server->listen_after_bind(); });
  // The library forgets a stop() that comes before it listens.
  while (!state->server.is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return ViewServer(std::move(state));
}

}  // namespace maquette::tools
