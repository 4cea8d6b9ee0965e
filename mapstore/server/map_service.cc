// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/map_service.h"

#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <exception>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/map/shift_report_check.h"
#include "mapstore/server/codec/map_service_codec.h"

namespace shiftmap::server {
namespace {

using Clock = std::chrono::steady_clock;

// A piece of a file in one message.
constexpr std::size_t kPieceBytes = std::size_t{64} << 10;

constexpr std::size_t kMaxMessageTextBytes = 1024;

// What a peer did wrong is worth a look, what it wrote a line, and what it read none.
JsonLog::Level LevelOf(Call call, StatusCode code) {
  switch (code) {
    case StatusCode::kOk:
      return call == Call::kSubmitReport || call == Call::kUploadLog ? JsonLog::Level::kInfo
                                                                     : JsonLog::Level::kDebug;
    case StatusCode::kUnauthenticated:
    case StatusCode::kPermissionDenied:
    case StatusCode::kInvalidArgument:
    case StatusCode::kDataLoss:
    case StatusCode::kResourceExhausted:
    case StatusCode::kUnavailable:
      return JsonLog::Level::kWarning;
    case StatusCode::kInternal:
      return JsonLog::Level::kError;
    default:
      return JsonLog::Level::kInfo;
  }
}

std::string OutcomeOf(const StatusOr<ReturnResult>& result) {
  if (result.ok()) return result->duplicate ? "duplicate" : "accepted";
  const StatusCode code = result.status().code();
  const bool refused = code == StatusCode::kInvalidArgument || code == StatusCode::kNotFound ||
                       code == StatusCode::kPermissionDenied;
  return refused ? "refused" : "failed";
}

Status CheckVehicle(const Caller& caller, const char* what, const std::string& vehicle) {
  if (MayActFor(caller, vehicle)) return OkStatus();
  return MakeStatus(StatusCode::kPermissionDenied,
                    "{}: vehicle '{}', but the certificate is of '{}'",
                    what,
                    vehicle,
                    caller.name);
}

}  // namespace

Peer PeerOf(const grpc::ServerContextBase& context) {
  Peer peer{context.peer(), ""};
  for (const auto& pem : context.auth_context()->FindPropertyValues("x509_pem_cert")) {
    peer.certificate.assign(pem.data(), pem.size());
  }
  return peer;
}

grpc::Status ToGrpc(const Status& status) {
  if (status.ok()) return grpc::Status::OK;
  std::string text = InertLine(Message(status));
  if (text.size() > kMaxMessageTextBytes) text.resize(kMaxMessageTextBytes);
  return {static_cast<grpc::StatusCode>(status.code()), text};
}

void MapService::Note(const grpc::ServerContextBase& context,
                      Call call,
                      const std::string& client,
                      const Status& status,
                      double duration_s) {
  parts_.metrics->CountCall(call, status.code(), duration_s);
  const JsonLog::Level level = LevelOf(call, status.code());
  if (!parts_.log->Writes(level)) return;
  Json fields = {{"call", NameOf(call)},
                 {"client", client},
                 {"peer", context.peer()},
                 {"code", CodeName(status.code())},
                 {"duration_s", duration_s}};
  if (!status.ok()) fields["message"] = Message(status);
  parts_.log->Write(level, "call", fields);
}

Status MapService::Admit(const grpc::ServerContextBase& context, Call call, Caller* caller) {
  SHIFTMAP_ASSIGN_OR_RETURN(*caller, parts_.gate->Identify(PeerOf(context)));
  return parts_.gate->Admit(*caller, call);
}

grpc::Status MapService::Serve(const grpc::ServerContextBase& context,
                               Call call,
                               const Body& body) {
  const Clock::time_point begin = Clock::now();
  Status status;
  Caller caller;
  // No exception may leave: it would end the server.
  try {
    status = Admit(context, call, &caller);
    if (status.ok()) status = body(caller);
  } catch (const std::bad_alloc&) {
    status = MakeStatus(StatusCode::kResourceExhausted, "out of memory");
  } catch (const std::exception& error) {
    status = Internal("{}", error.what());
  }
  Note(context,
       call,
       caller.name,
       status,
       std::chrono::duration<double>(Clock::now() - begin).count());
  return ToGrpc(status);
}

grpc::Status MapService::ListAreas(grpc::ServerContext* context,
                                   const proto::ListAreasRequest* /*request*/,
                                   proto::ListAreasResponse* response) {
  return Serve(*context, Call::kListAreas, [&](const Caller&) {
    return parts_.readers->Read([&](MapStore& store) -> Status {
      SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AreaSummary> areas, store.Areas());
      ToProto(areas, response);
      return OkStatus();
    });
  });
}

grpc::Status MapService::ListVersions(grpc::ServerContext* context,
                                      const proto::ListVersionsRequest* request,
                                      proto::ListVersionsResponse* response) {
  return Serve(*context, Call::kListVersions, [&](const Caller&) {
    return parts_.readers->Read([&](MapStore& store) -> Status {
      SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions,
                                store.Versions(request->area()));
      ToProto(versions, response);
      return OkStatus();
    });
  });
}

grpc::Status MapService::GetSnapshot(grpc::ServerContext* context,
                                     const proto::GetSnapshotRequest* request,
                                     proto::Snapshot* response) {
  return Serve(*context, Call::kGetSnapshot, [&](const Caller&) -> Status {
    const std::optional<SnapshotInfo> newest = parts_.snapshots->Newest(request->area());
    if (!newest) return NotFound("area '{}': no snapshot", request->area());
    ToProto(*newest, response);
    return OkStatus();
  });
}

grpc::Status MapService::FetchSnapshot(grpc::ServerContext* context,
                                       const proto::FetchSnapshotRequest* request,
                                       grpc::ServerWriter<proto::FetchSnapshotResponse>* writer) {
  return Serve(*context, Call::kFetchSnapshot, [&](const Caller& caller) -> Status {
    SHIFTMAP_RETURN_IF_ERROR(CheckRequest(*request));
    SHIFTMAP_ASSIGN_OR_RETURN(const Slots::Slot slot, parts_.transfers->Take(caller.limit_key));
    SHIFTMAP_ASSIGN_OR_RETURN(const OpenSnapshot snapshot,
                              parts_.snapshots->OpenFile(request->area(), request->sha256()));
    if (request->offset_bytes() > snapshot.info.size_bytes) {
      return MakeStatus(StatusCode::kOutOfRange,
                        "offset_bytes {}: the snapshot has {}",
                        request->offset_bytes(),
                        snapshot.info.size_bytes);
    }
    proto::FetchSnapshotResponse head;
    ToProto(snapshot.info, head.mutable_snapshot());
    const bool has_it = request->sha256().empty() && request->have_sha256() == snapshot.info.sha256;
    head.set_not_changed(has_it);
    if (!writer->Write(head)) return MakeStatus(StatusCode::kCancelled, "the client went");
    return has_it ? OkStatus() : Send(snapshot, request->offset_bytes(), writer);
  });
}

Status MapService::Send(const OpenSnapshot& snapshot,
                        std::int64_t offset_bytes,
                        grpc::ServerWriter<proto::FetchSnapshotResponse>* writer) const {
  proto::FetchSnapshotResponse piece;
  while (offset_bytes < snapshot.info.size_bytes) {
    std::string* const data = piece.mutable_data();
    data->resize(kPieceBytes);
    const ssize_t got = pread(snapshot.fd.get(), data->data(), data->size(), offset_bytes);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) {
      return Unavailable("snapshot {}: cannot be read at {}", snapshot.info.sha256, offset_bytes);
    }
    data->resize(static_cast<std::size_t>(got));
    offset_bytes += got;
    if (!writer->Write(piece)) return MakeStatus(StatusCode::kCancelled, "the client went");
  }
  return OkStatus();
}

grpc::Status MapService::GetModeProbabilities(grpc::ServerContext* context,
                                              const proto::GetModeProbabilitiesRequest* request,
                                              proto::GetModeProbabilitiesResponse* response) {
  return Serve(*context, Call::kGetModeProbabilities, [&](const Caller&) {
    std::optional<VersionNumber> version;
    if (request->version() != 0) version = VersionNumber(request->version());
    const Stamp at = request->at_ns() == 0 ? SystemNow() : StampFromNanoseconds(request->at_ns());
    return parts_.readers->Read([&](MapStore& store) -> Status {
      SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, store.LoadAt(request->area(), version, at));
      return ToProto(map, {request->signature().begin(), request->signature().end()}, response);
    });
  });
}

grpc::Status MapService::SubmitReport(grpc::ServerContext* context,
                                      const proto::SubmitReportRequest* request,
                                      proto::SubmitReportResponse* response) {
  return Serve(*context, Call::kSubmitReport, [&](const Caller& caller) -> Status {
    const auto submit = [&]() -> StatusOr<ReturnResult> {
      SHIFTMAP_ASSIGN_OR_RETURN(ShiftReport report, FromProto(*request));
      SHIFTMAP_RETURN_IF_ERROR(CheckVehicle(caller, "report", report.vehicle));
      SHIFTMAP_RETURN_IF_ERROR(CheckClockWasSet("shift report " + report.uuid, report.begin));
      return parts_.writer->Return(std::move(report), caller.name);
    };
    const StatusOr<ReturnResult> result = submit();
    parts_.metrics->CountReport(OutcomeOf(result));
    if (result.ok()) ToProto(*result, response);
    return result.status();
  });
}

grpc::Status MapService::GetUpload(grpc::ServerContext* context,
                                   const proto::GetUploadRequest* request,
                                   proto::UploadState* response) {
  return Serve(*context, Call::kGetUpload, [&](const Caller& caller) -> Status {
    if (!IsSha256Hex(request->sha256())) {
      return InvalidArgument("sha256: expected 64 lower-case hex digits");
    }
    if (parts_.uploads == nullptr) return FailedPrecondition("this server takes no logs");
    SHIFTMAP_ASSIGN_OR_RETURN(const UploadProgress progress,
                              parts_.uploads->Progress(caller.name, request->sha256()));
    response->set_stored_bytes(progress.stored_bytes);
    response->set_complete(progress.complete);
    return OkStatus();
  });
}

Status MapService::AcceptLog(const Caller& caller, const std::string& sha256, const RunInfo& info) {
  SHIFTMAP_RETURN_IF_ERROR(CheckVehicle(caller, "run log", info.vehicle));
  return parts_.writer->NoteUpload(sha256, caller.name);
}

Status MapService::Receive(const Caller& caller,
                           grpc::ServerReader<proto::UploadLogRequest>* reader,
                           proto::UploadState* response) {
  proto::UploadLogRequest message;
  if (!reader->Read(&message) || !message.has_header()) {
    return InvalidArgument("expected a header first");
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const UploadRequest request, FromProto(message.header()));
  StatusOr<UploadSpool::Upload> upload =
      parts_.uploads->Begin(caller.name, request.sha256, request.size_bytes, request.offset_bytes);
  if (upload.status().code() == StatusCode::kAlreadyExists) {
    response->set_stored_bytes(request.size_bytes);
    response->set_complete(true);
    return OkStatus();
  }
  if (!upload.ok()) return upload.status();
  while (reader->Read(&message)) {
    if (message.part_case() != proto::UploadLogRequest::kData) {
      return InvalidArgument("expected data after the header");
    }
    SHIFTMAP_RETURN_IF_ERROR(upload->Append(message.data()));
    parts_.metrics->CountUploadedBytes(static_cast<std::int64_t>(message.data().size()));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const UploadProgress progress,
                            parts_.uploads->Finish(*std::move(upload), [&](const RunInfo& info) {
                              return AcceptLog(caller, request.sha256, info);
                            }));
  response->set_stored_bytes(progress.complete ? request.size_bytes : progress.stored_bytes);
  response->set_complete(progress.complete);
  return OkStatus();
}

grpc::Status MapService::UploadLog(grpc::ServerContext* context,
                                   grpc::ServerReader<proto::UploadLogRequest>* reader,
                                   proto::UploadState* response) {
  return Serve(*context, Call::kUploadLog, [&](const Caller& caller) -> Status {
    if (parts_.uploads == nullptr) return FailedPrecondition("this server takes no logs");
    SHIFTMAP_ASSIGN_OR_RETURN(const Slots::Slot slot, parts_.transfers->Take(caller.limit_key));
    return Receive(caller, reader, response);
  });
}

}  // namespace shiftmap::server
