# The answers of the driver in GDScript to `samples/driver/vectors.json`, under Godot 3:
#
#     godot3-server --no-window --path FOLDER -s vectors.gd
#
# The folder has project.godot, this file, answers.gd, the driver's files and vectors.json, and gets played.json. With a
# baked.glb there, flesh knows the clips that are in it.
extends SceneTree


func _init():
	var clips = null
	if File.new().file_exists("res://baked.glb"):
		var node = load("res://driver_godot3.gd").new()
		var gltf = node.read("res://baked.glb")
		clips = load("res://clips.gd").new(gltf, node.stream, node.start)
		node.free()
	var cases = JSON.parse(text_of("res://vectors.json")).result
	var file = File.new()
	file.open("res://played.json", File.WRITE)
	file.store_string(written(load("res://answers.gd").all(cases, clips)))
	file.close()
	quit()


func text_of(path):
	var file = File.new()
	file.open(path, File.READ)
	var text = file.get_as_text()
	file.close()
	return text


# JSON with all digits: Godot's own writes six of them.
func written(value):
	if value is Dictionary or value is Array:
		var parts = PoolStringArray()
		for each in value:
			parts.append(to_json(each) + ":" + written(value[each]) if value is Dictionary else written(each))
		return ("{%s}" if value is Dictionary else "[%s]") % parts.join(",")
	return "%.15f" % value if value is float else to_json(value)
