# The answers of the driver in GDScript to `samples/driver/vectors.json`, under Godot 3:
#
#     godot3-server --no-window --path FOLDER -s vectors.gd
#
# The folder has project.godot, this file, the driver's files and vectors.json, and gets played.json. With a baked.glb there,
# flesh knows the clips that are in it.
extends SceneTree

var clips = null


func _init():
	var cases = JSON.parse(text_of("res://vectors.json")).result
	var Body = load("res://wrinkle.gd")
	if File.new().file_exists("res://baked.glb"):
		var node = load("res://driver_godot3.gd").new()
		var gltf = node.read("res://baked.glb")
		clips = load("res://clips.gd").new(gltf, node.stream, node.start)
		node.free()
	var found = {}
	for label in cases:
		var each = cases[label]
		var runs = []
		var unseen = []
		for run in each["runs"]:
			runs.append(played(Body.new(each["wrinkle"]), each, run))
			unseen.append(Body.new(each["wrinkle"]).unseen_rounds(run["seconds"]))
		var joints = each["joints"].duplicate()
		var targets = each["targets"].duplicate()
		joints.pop_front()
		targets.pop_front()
		var problems = Body.new(each["wrinkle"], joints, targets).problems
		var later = each["wrinkle"].duplicate()
		later["layout"] = Body.LAYOUT + 1
		found[label] = {"runs": runs, "unseen": unseen, "problems": problems + Body.new(later).problems}
	var file = File.new()
	file.open("res://played.json", File.WRITE)
	file.store_string(written(found))
	file.close()
	quit()


func text_of(path):
	var file = File.new()
	file.open(path, File.READ)
	var text = file.get_as_text()
	file.close()
	return text


func played(body, each, run):
	var frames = []
	body.clips = clips
	for number in range(run["elapsed"].size()):
		var k = number % run["times"].size()
		var matrices = {}
		for joint in range(each["joints"].size()):
			matrices[each["joints"][joint]] = run["matrices"][k][joint]
		var morphs = {}
		for target in range(each["morphs"].size()):
			morphs[each["morphs"][target]] = run["morphs"][k][target]
		var hands = {}
		if run.get("hands", [null])[k if run.has("hands") else 0] != null:
			var hand = run["hands"][k]
			hands[each["wrinkle"]["touches"][0]["name"]] = {"slide": [hand[0], hand[1]], "depth": hand[2]}
		body.others = run.get("others", [{}])[k if run.has("others") else 0]
		var elapsed = NAN if run["elapsed"][number] == null else run["elapsed"][number]
		var weights = body.weights(matrices, morphs, run["clip"], run["times"][k], elapsed, hands)
		var row = []
		for target in each["targets"]:
			row.append(weights[target])
		frames.append(row)
	return frames


# JSON with all digits: Godot's own writes six of them.
func written(value):
	if value is Dictionary or value is Array:
		var parts = PoolStringArray()
		for each in value:
			parts.append(to_json(each) + ":" + written(value[each]) if value is Dictionary else written(each))
		return ("{%s}" if value is Dictionary else "[%s]") % parts.join(",")
	return "%.15f" % value if value is float else to_json(value)
