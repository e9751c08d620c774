-- Wireshark dissector of the Telenano protocol, version 1 (PROTOCOL.md). Header, type and every field by its name in
-- telenano.proto, for UDP datagrams that begin with the magic number, whatever their port.
--   wireshark -X lua_script:proto/telenano.lua session.pcapng
--   tshark -X lua_script:proto/telenano.lua -r session.pcapng -Y telenano
-- Filters: telenano.type == 5, telenano.command.sequence == 7, telenano.malformed.

local telenano = Proto("telenano", "Telenano")

-- Each field as {number, name, kind, names of values}. Kinds: i fixed32, q fixed64, x either shown in hexadecimal, d double,
-- b bytes.
-- Made by telenano-schema of telenano.proto: change it there.
local types = {
    [1] = "Hello", [2] = "Challenge", [3] = "Welcome", [4] = "Refuse", [5] = "Command", [6] = "Reply", [7] = "Bye",
    [8] = "SceneRequest", [9] = "SceneChunk", [10] = "SnapshotRequest", [11] = "SnapshotPiece",
    [12] = "SceneListRequest", [13] = "SceneListEntry", [14] = "SceneSwitch",
}
local values = {
  RefuseReason = {
    [1] = "version", [2] = "full", [3] = "rate", [4] = "shutting down", [5] = "scene",
  },
  ByeReason = {
    [1] = "done", [2] = "idle", [3] = "shutting down", [4] = "stopped", [5] = "unknown session",
  },
  ContactState = {
    [0] = "free", [1] = "van der Waals", [2] = "non-contact", [3] = "contact",
  },
  ParticleStatus = {
    [0] = "rests", [1] = "pushed", [2] = "held", [3] = "lost",
  },
  PortMethod = {
    [0] = "none", [1] = "ks", [2] = "ks-clamp", [3] = "tdpa", [4] = "wave", [5] = "tank", [6] = "model", [7] = "twin",
  },
  StepBreak = {
    [0] = "none", [1] = "gap", [2] = "stop", [3] = "right", [4] = "silence", [5] = "share", [6] = "holder",
    [7] = "undo",
  },
}
local messages = {
  [1] = {  -- Hello
    { 1, "version_min", "i" }, { 2, "version_max", "i" }, { 3, "feature_bits", "x" }, { 4, "nonce", "x" },
    { 5, "cookie", "x" }, { 6, "resume_token", "x" }, { 7, "rate_hz", "i" }, { 15, "padding", "b" },
  },
  [2] = {  -- Challenge
    { 1, "nonce", "x" }, { 2, "cookie", "x" },
  },
  [3] = {  -- Welcome
    { 1, "version", "i" }, { 2, "feature_bits", "x" }, { 3, "nonce", "x" }, { 4, "session_id", "x" },
    { 5, "resume_token", "x" }, { 6, "epoch", "i" }, { 7, "timeout_ms", "i" }, { 8, "slave_rate_max_hz", "i" },
    { 9, "scene_name", "b" }, { 10, "scene_hash", "x" }, { 11, "workspace_min_w_x_nm", "d" },
    { 12, "workspace_min_w_y_nm", "d" }, { 13, "workspace_min_w_z_nm", "d" }, { 14, "workspace_max_w_x_nm", "d" },
    { 15, "workspace_max_w_y_nm", "d" }, { 16, "workspace_max_w_z_nm", "d" }, { 17, "start_pos_w_x_nm", "d" },
    { 18, "start_pos_w_y_nm", "d" }, { 19, "start_pos_w_z_nm", "d" }, { 20, "surface_z_w_nm", "d" },
    { 21, "force_max_nn", "d" }, { 22, "coupling_stiffness_n_m", "d" }, { 23, "coupling_damping_n_s_m", "d" },
    { 24, "stiffness_min_n_m", "d" }, { 25, "well_aj", "d" }, { 26, "scene_sha256_0", "x" },
    { 27, "scene_sha256_1", "x" }, { 28, "scene_sha256_2", "x" }, { 29, "scene_sha256_3", "x" },
    { 30, "scene_bytes", "i" }, { 31, "canonical_motion", "x" }, { 40, "steps_executed", "q" },
    { 41, "state_hash", "x" }, { 42, "steps_breaks", "i" },
  },
  [4] = {  -- Refuse
    { 1, "nonce", "x" }, { 2, "reason", "i", values.RefuseReason }, { 3, "version_min", "i" },
    { 4, "version_max", "i" },
  },
  [5] = {  -- Command
    { 1, "session_id", "x" }, { 2, "sequence", "q" }, { 3, "send_time_ns", "q" }, { 4, "newest_reply", "q" },
    { 5, "epoch", "i" }, { 6, "flags", "i" }, { 7, "tip_vel_w_x_nm_s", "d" }, { 8, "tip_vel_w_y_nm_s", "d" },
    { 9, "tip_vel_w_z_nm_s", "d" }, { 10, "tip_pos_w_x_nm", "d" }, { 11, "tip_pos_w_y_nm", "d" },
    { 12, "tip_pos_w_z_nm", "d" }, { 13, "energy_in_j", "d" }, { 14, "energy_out_j", "d" },
    { 15, "method", "i", values.PortMethod }, { 16, "energy_scale_aj_j", "d" }, { 17, "energy_sent_j", "d" },
    { 18, "wave_sum_w_x_sqrt_aj_s", "d" }, { 19, "wave_sum_w_y_sqrt_aj_s", "d" }, { 20, "wave_sum_w_z_sqrt_aj_s", "d" },
    { 21, "wave_energy_aj", "d" }, { 22, "wave_impedance_n_s_m", "d" }, { 31, "tip_hold", "i" },
    { 32, "reply_floor_pn", "i" }, { 33, "reply_relative_permille", "i" }, { 40, "recent_commands", "b" },
    { 41, "steps", "b" },
  },
  [6] = {  -- Reply
    { 1, "session_id", "x" }, { 2, "sequence", "q" }, { 3, "command_sequence", "q" },
    { 4, "command_send_time_ns", "q" }, { 5, "server_time_ns", "q" }, { 6, "hold_time_ns", "q" },
    { 7, "measurement_age_ns", "q" }, { 8, "epoch", "i" }, { 9, "contact_state", "i", values.ContactState },
    { 10, "fault_bits", "i" }, { 11, "force_w_x_nn", "d" }, { 12, "force_w_y_nn", "d" }, { 13, "force_w_z_nn", "d" },
    { 14, "tip_pos_w_x_nm", "d" }, { 15, "tip_pos_w_y_nm", "d" }, { 16, "tip_pos_w_z_nm", "d" },
    { 17, "deflection_nm", "d" }, { 18, "energy_in_aj", "d" }, { 19, "energy_out_aj", "d" },
    { 20, "energy_sent_aj", "d" }, { 21, "wave_sum_w_x_sqrt_aj_s", "d" }, { 22, "wave_sum_w_y_sqrt_aj_s", "d" },
    { 23, "wave_sum_w_z_sqrt_aj_s", "d" }, { 24, "wave_energy_aj", "d" }, { 25, "model_version", "i" },
    { 26, "model_point_w_x_nm", "d" }, { 27, "model_point_w_y_nm", "d" }, { 28, "model_point_w_z_nm", "d" },
    { 29, "model_normal_w_x", "d" }, { 30, "model_normal_w_y", "d" }, { 31, "model_normal_w_z", "d" },
    { 32, "model_stiffness_n_m", "d" }, { 33, "model_adhesion_nn", "d" }, { 34, "model_shear_stiffness_n_m", "d" },
    { 35, "model_friction_nn", "d" }, { 36, "tip_hold", "i" }, { 37, "hold_pos_w_x_nm", "d" },
    { 38, "hold_pos_w_y_nm", "d" }, { 39, "hold_pos_w_z_nm", "d" }, { 40, "steps_before", "q" },
    { 41, "particle_pos_w_x_nm", "d" }, { 42, "particle_pos_w_y_nm", "d" }, { 43, "particle_pos_w_z_nm", "d" },
    { 44, "particle_radius_nm", "d" }, { 45, "particle_state", "i", values.ParticleStatus },
    { 46, "steps_executed", "q" }, { 47, "state_hash", "x" }, { 48, "steps_newest", "q" }, { 49, "steps_breaks", "i" },
    { 50, "break_reason", "i", values.StepBreak }, { 51, "break_step", "q" }, { 52, "replies_left_out", "q" },
  },
  [7] = {  -- Bye
    { 1, "session_id", "x" }, { 2, "reason", "i", values.ByeReason },
  },
  [8] = {  -- SceneRequest
    { 1, "session_id", "x" }, { 2, "bundle", "x" }, { 3, "chunk", "i" },
  },
  [9] = {  -- SceneChunk
    { 1, "session_id", "x" }, { 2, "bundle", "x" }, { 3, "chunk", "i" }, { 4, "data", "b" },
  },
  [10] = {  -- SnapshotRequest
    { 1, "session_id", "x" }, { 2, "snapshot", "i" }, { 3, "piece", "i" },
  },
  [11] = {  -- SnapshotPiece
    { 1, "session_id", "x" }, { 2, "snapshot", "i" }, { 3, "piece", "i" }, { 4, "step", "q" }, { 5, "state_hash", "x" },
    { 6, "breaks", "i" }, { 7, "total", "i" }, { 8, "data", "b" },
  },
  [12] = {  -- SceneListRequest
    { 1, "session_id", "x" }, { 2, "index", "i" },
  },
  [13] = {  -- SceneListEntry
    { 1, "session_id", "x" }, { 2, "index", "i" }, { 3, "count", "i" }, { 4, "scene_hash", "x" },
    { 5, "scene_name", "b" },
  },
  [14] = {  -- SceneSwitch
    { 1, "session_id", "x" }, { 2, "nonce", "x" }, { 3, "scene_hash", "x" },
  },
}
-- End of what is made.

local header = {
  magic = ProtoField.string("telenano.magic", "Magic"),
  version = ProtoField.uint8("telenano.version", "Version"),
  type = ProtoField.uint8("telenano.type", "Type", base.DEC, types),
  length = ProtoField.uint16("telenano.length", "Payload length"),
}
telenano.fields = { header.magic, header.version, header.type, header.length }
local malformed = ProtoExpert.new("telenano.malformed", "Not as PROTOCOL.md says", expert.group.MALFORMED,
  expert.severity.ERROR)
telenano.experts = { malformed }

-- fields[type][number] = {field, wire type, bytes}
local fields = {}
for type, list in pairs(messages) do
  fields[type] = {}
  for _, entry in ipairs(list) do
    local number, name, kind, names = entry[1], entry[2], entry[3], entry[4]
    local filter = "telenano." .. types[type]:lower() .. "." .. name
    local field, wire, bytes
    if kind == "i" then
      field, wire, bytes = ProtoField.uint32(filter, name, base.DEC, names), 5, 4
    elseif kind == "q" then
      field, wire, bytes = ProtoField.uint64(filter, name), 1, 8
    elseif kind == "x" then
      field, wire, bytes = ProtoField.uint64(filter, name, base.HEX), 1, 8
    elseif kind == "d" then
      field, wire, bytes = ProtoField.double(filter, name), 1, 8
    elseif name == "scene_name" then
      field, wire = ProtoField.string(filter, name), 2
    else
      field, wire = ProtoField.bytes(filter, name), 2
    end
    table.insert(telenano.fields, field)
    fields[type][number] = { field = field, wire = wire, bytes = bytes }
  end
end

-- A length or tag of one or two bytes in its shortest form: value and place behind it, or nil.
local function varint(buffer, at)
  if at >= buffer:len() then return nil end
  local low = buffer(at, 1):uint()
  if low < 0x80 then return low, at + 1 end
  if at + 1 >= buffer:len() then return nil end
  local high = buffer(at + 1, 1):uint()
  if high == 0 or high >= 0x80 then return nil end
  return low - 0x80 + high * 0x80, at + 2
end

-- Adds the fields from `at`; says what is wrong, or nil.
local function add_fields(buffer, at, type, tree)
  local seen = {}
  while at < buffer:len() do
    local tag
    tag, at = varint(buffer, at)
    if not tag then return "tag cut or too long" end
    local number, wire = math.floor(tag / 8), tag % 8
    local known = fields[type][number]
    if not known or known.wire ~= wire then return "field " .. number .. " is not of this message" end
    if seen[number] then return "field " .. number .. " comes twice" end
    seen[number] = true
    local bytes = known.bytes
    if wire == 2 then
      bytes, at = varint(buffer, at)
      if not bytes then return "length cut or too long" end
    end
    if at + bytes > buffer:len() then return "field " .. number .. " is cut" end
    if type == 5 and number == 41 and (bytes <= 9 or bytes > 300 or at + bytes ~= buffer:len()) then
      return "steps are not 10 to 300 bytes at the end"
    end
    if type == 5 and number == 40 and (bytes == 0 or bytes % 64 ~= 0 or bytes > 256 or at + bytes ~= buffer:len()) then
      return "repeated commands are not 1 to 4 whole records at the end"
    end
    if type == 13 and wire == 2 and (bytes == 0 or bytes > 48 or at + bytes ~= buffer:len()) then
      return "a name is not 1 to 48 bytes at the end"
    end
    if (type == 9 or type == 11) and wire == 2 and (bytes == 0 or bytes > 464 or at + bytes ~= buffer:len()) then
      return "data are not 1 to 464 bytes at the end"
    end
    if wire == 2 then
      tree:add(known.field, buffer(at, bytes))
    else
      tree:add_le(known.field, buffer(at, bytes))
    end
    at = at + bytes
  end
  return nil
end

function telenano.dissector(buffer, packet, root)
  if buffer:len() < 8 or buffer(0, 4):string() ~= "TLNO" then return 0 end
  packet.cols.protocol = "Telenano"
  local tree = root:add(telenano, buffer())
  tree:add(header.magic, buffer(0, 4))
  tree:add(header.version, buffer(4, 1))
  tree:add(header.type, buffer(5, 1))
  tree:add_le(header.length, buffer(6, 2))
  local version, type, length = buffer(4, 1):uint(), buffer(5, 1):uint(), buffer(6, 2):le_uint()
  local name = types[type] or ("type " .. type)
  packet.cols.info = name
  tree:append_text(", " .. name)
  local wrong
  if not types[type] then
    wrong = "no such type"
  elseif version ~= 1 and type ~= 1 and type ~= 4 then
    wrong = "another version"
  elseif buffer:len() > 512 then
    wrong = "more than 512 bytes"
  elseif buffer:len() ~= 8 + length then
    wrong = "payload of " .. (buffer:len() - 8) .. " bytes, " .. length .. " in the header"
  else
    wrong = add_fields(buffer, 8, type, tree)
  end
  if wrong then tree:add_proto_expert_info(malformed, "Not as PROTOCOL.md says: " .. wrong) end
  return buffer:len()
end

telenano:register_heuristic("udp", function(buffer, packet, root)
  if buffer:len() < 8 or buffer(0, 4):string() ~= "TLNO" then return false end
  telenano.dissector(buffer, packet, root)
  return true
end)
