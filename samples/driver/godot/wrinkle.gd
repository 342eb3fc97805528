# Drives the morph targets of `extras.wrinkle`: one text for Godot 3 and 4, which needs no node of either.
#
#     var body = load("wrinkle.gd").new(extras["wrinkle"])
#     var weights = body.weights(matrices, morphs, clip, time, elapsed)
#
# README.md in the folder above says what is computed, and why. Drives stay as the JSON has them.

const Numbers = preload("numbers.gd")
const Joints = preload("joints.gd")
# The layout of the extras that this reads; extras that name none have layout 1.
const LAYOUT = 3
# Of a loop that begins at rest so much of a swing is left when it is shown; and rounds that it plays unseen at most.
const LEFT = 0.001
const MOST_ROUNDS = 100
# The lists of drives in the order in which they act.
const KINDS = ["muscles", "flesh", "touches", "tools", "fields", "folds"]

# A line for each drive that is left out or does not show.
var problems = []
# The clips of the file, as of clips.gd, so that flesh follows a smooth curve through their keys; null if they are unknown.
var clips = null
# While clips blend, those beside the one that `weights` gets: {CLIP: {"time": seconds, "share": 1 is all of the motion}}.
var others = {}
# The matrix to world space of what the file's scene stands below, for these: 16 numbers by columns.
var root = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
var _drives = []
var _found = {}
# Of this frame, for the drives: what `weights` gets.
var matrices = {}
var morphs = {}
var clip = ""
var time = 0.0
var elapsed = NAN


# `joints` and `targets`, if not null, are arrays or dictionaries of the names that there are.
func _init(wrinkle, joints = null, targets = null):
	var layout = wrinkle.get("layout", 1)
	if layout != LAYOUT:
		var line = "its extras have layout %d, and this driver reads %d: bake its source again, or take its version's driver"
		problems.append(line % [layout, LAYOUT])
		return
	for kind in KINDS:
		for drive in wrinkle.get(kind, []):
			var label = drive.get("name", "the fold of \"%s\"" % drive.get("joint", ""))
			var absent = _missing(joints_of(drive), joints)
			var lost = _missing(drive["targets"], targets)
			if absent != "":
				problems.append("%s is left out, as there is no joint %s" % [label, absent])
			if lost != "":
				problems.append("%s does not show, as there is no morph target %s" % [label, lost])
			if absent == "":
				_drives.append({"kind": kind, "data": drive, "state": {}})


# The weights of a frame by morph target, in a dictionary that the next call uses again.
#
# joint_matrices  {JOINT: 16 numbers by columns}, to world space
# own_morphs      {TARGET: weight} of targets that no drive sets
# since           seconds since the last frame; where it is NAN, nothing lags or swings
# hands           {TOUCH: {"slide": [forward, sideways], "depth": depth}} where the player's own tips touch, scene units
func weights(joint_matrices, own_morphs = {}, clip_name = "", seconds = 0.0, since = NAN, hands = {}):
	_found.clear()
	matrices = joint_matrices
	morphs = own_morphs
	clip = clip_name
	time = seconds
	elapsed = since
	for each in _drives:
		var data = each["data"]
		var values = []
		if each["kind"] == "flesh":
			values = Joints.flesh(self, data, each["state"])
		elif each["kind"] == "touches":
			values = Joints.touch(self, data, each["state"], hands.get(data["name"]))
		elif data.has("joint"):
			values = Joints.fold(self, data)
		elif data.has("turns"):
			values = Joints.field(self, data)
		else:
			values = _segment(data, each["state"])
		var factor = data.get("strengths", {}).get(clip, data.get("strength", 1.0))
		# A clip that was baked may have targets of its own, which stand for all.
		for target in data.get("own", []):
			if morph(target) != 0:
				factor = 0.0
		values = _split(Numbers.times(factor, values), data.get("lows", []))
		for k in range(values.size()):
			_found[data["targets"][k]] = values[k]
	return _found


# How often a clip of so many seconds that loops is to be played unseen, from rest, before it is shown: then it begins as it
# ends, as it does in a bake. 0 without springs.
func unseen_rounds(seconds):
	var rounds = 0
	for each in _drives:
		var data = each["data"]
		var springs = [data["release"]] if data.has("by") else data.get("modes", [])
		for spring in [data["lag"]] if data.has("lag") else springs:
			var damping = spring["damping"]
			var slower = damping + sqrt(damping * damping - 1.0) if damping > 1 else 1.0 / damping
			var fading = 2.0 * PI * spring["frequency"] / slower
			rounds = Numbers.larger(rounds, ceil(-log(LEFT) / (fading * seconds)))
	return int(Numbers.smaller(rounds, MOST_ROUNDS))


# The names of all morph targets that it sets.
func driven():
	var found = []
	for each in _drives:
		found += each["data"]["targets"]
	return found


# The names of the joints that a drive needs.
static func joints_of(drive):
	var found = []
	if drive.has("joint"):
		for key in ["joint", "parent"]:
			found += [drive[key]] if drive.has(key) else []
		return found + (joints_of(drive["other"]) if drive.has("other") else [])
	if drive.has("turns"):
		for turn in drive["turns"]:
			found += joints_of(turn)
		return found
	for anchor in _anchors(drive) + ([drive["by"]] if drive.has("by") else []) + drive.get("limb", []) + _anchors_of_row(drive):
		found += anchor["joints"]
	return found


func _missing(names, there):
	var lost = []
	for each in names:
		if there != null and not there.has(each) and not lost.has(each):
			lost.append(each)
	var line = ""
	for each in lost:
		line += (", " if line != "" else "") + "\"%s\"" % each
	return line


# The weight of a morph target, driven or not.
func morph(target):
	return _found[target] if _found.has(target) else morphs.get(target, 0.0)


static func _anchors_of_row(drive):
	var found = []
	for place in drive.get("row", []):
		found += place["anchors"]
	return found


static func _anchors(drive):
	return drive["anchors"] if drive.has("anchors") else [drive["origin"], drive["target"]]


# [place in the world, the joints' scale against rest]
func placed(anchor):
	var place = [0.0, 0.0, 0.0]
	var scale = 0.0
	for k in range(anchor["joints"].size()):
		var matrix = matrices[anchor["joints"][k]]
		var point = anchor["positions"][k]
		for target in anchor.get("morphs", {}):
			point = Numbers.sum(point, anchor["morphs"][target][k], morph(target))
		place = Numbers.sum(place, Numbers.moved(matrix, point), anchor["weights"][k])
		scale += anchor["weights"][k] * Numbers.scale(matrix) / anchor["scales"][k]
	return [place, scale]


func _segment(data, state):
	var scale = 0.0
	var distance = 0.0
	var last = null
	var anchors = _anchors(data)
	for anchor in anchors:
		var found_at = placed(anchor)
		if last != null:
			distance += Numbers.length(Numbers.sum(found_at[0], last, -1.0))
		last = found_at[0]
		scale += found_at[1] / anchors.size()
	var lag = data.get("lag")
	if scale < 1e-6:
		if lag != null:
			_lagged(state, lag, -1.0)
		return Numbers.times(0.0, range(data.get("lows", data["targets"]).size()))
	var length = data["rest_length"]
	if data.has("rest_length_morph"):
		var follows = data["rest_length_morph"]
		length += Numbers.held(morph(follows["name"]), 0.0, 1.0) * (follows["full"] - length)
	if data.get("rest_length_keys", {}).has(clip):
		length = Numbers.point(data["rest_length_keys"][clip], time)
	var ends = distance / scale
	var belly = ends
	if data.has("tension"):
		belly -= data["tension"]["length"] * _activation(data["tension"])
	if lag != null:
		var x = Numbers.smaller(_lagged(state, lag, lag["taut"] - belly / length), lag["taut"])
		belly = (lag["taut"] - x) * length if x > 0 else Numbers.larger(belly, lag["taut"] * length)
	var rows = data["shortenings"]
	if not data.has("gains"):
		return Numbers.times(length / data["rest_length"], Numbers.row(rows, data["weights"], 1.0 - belly / length))
	var gain = Numbers.number(rows, data["gains"], 1.0 - belly / length)
	return Numbers.times(gain, Numbers.row(rows, data["weights"], 1.0 - ends / length))


# Weights below 0 on further targets, for engines that have no such weights.
static func _split(found, lows):
	for k in range(lows.size()):
		if lows[k] > 0:
			found.append(Numbers.larger(-found[k], 0.0) / lows[k])
			found[k] = Numbers.larger(found[k], 0.0)
	return found


# An activation shortens a muscle whose ends stay.
func _activation(tension):
	if tension.has("morph"):
		return Numbers.held(morph(tension["morph"]), 0.0, 1.0)
	return Numbers.point(tension["keys"][clip], time) if tension["keys"].has(clip) else 0.0


# The shortening that tissue follows, which may be below 0; `now` is below 0 where it is stretched.
func _lagged(state, lag, now):
	var turns = 2.0 * PI * lag["frequency"] * elapsed
	if is_nan(turns) or not state.has("spring"):
		state["spring"] = [Numbers.larger(now, 0.0), 0.0]
		state["before"] = now
	var before = state["before"]
	if turns > 0:
		# Where it begins or ends to be shorter between two frames, the line bends.
		var crosses = before * now < 0
		var bend = before / (before - now) if crosses else 1.0
		var middle = 0.0 if crosses else Numbers.larger(now, 0.0)
		state["spring"] = Numbers.passed(state["spring"], Numbers.larger(before, 0.0), middle, lag["damping"], bend * turns)
		if crosses:
			state["spring"] = Numbers.passed(state["spring"], 0.0, Numbers.larger(now, 0.0), lag["damping"], (1.0 - bend) * turns)
	state["before"] = now
	return state["spring"][0]
